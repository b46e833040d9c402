// MuJoCo's own stages in a plain loop over states: of mj_inverse and mj_forward what an arm without contacts, constraints,
// actuators and sensors needs. Positions, speeds and torques are (count, nv), row-major.

#include <mujoco/mujoco.h>
#include <string.h>

#define EXPORTED __attribute__((visibility("default")))

static void place(const mjModel* m, mjData* d, const double* q) {
  memcpy(d->qpos, q, m->nq * sizeof(double));
  mj_kinematics(m, d);
  mj_comPos(m, d);
}

static void move(const mjModel* m, mjData* d, const double* qd) {
  memcpy(d->qvel, qd, m->nv * sizeof(double));
  mj_comVel(m, d);
}

EXPORTED void inverse_dynamics(
  const mjModel* m, mjData* d, long count, const double* q, const double* qd, const double* qdd, double* tau) {
  const int n = m->nv;
  for (long k = 0; k < count * n; k += n) {
    place(m, d, q + k);
    move(m, d, qd + k);
    memcpy(d->qacc, qdd + k, n * sizeof(double));
    mj_rne(m, d, 1, tau + k);
    for (int i = 0; i < n; ++i)
      tau[k + i] += m->dof_armature[i] * qdd[k + i];  // which mj_rne leaves out, and mj_inverse adds
  }
}

EXPORTED void mass_matrix(const mjModel* m, mjData* d, long count, const double* q, double* full) {
  const int n = m->nv;
  for (long k = 0; k < count; ++k) {
    place(m, d, q + k * n);
    mj_crb(m, d);
    mj_fullM(m, d, full + k * n * n);
  }
}

EXPORTED void forward_dynamics(
  const mjModel* m, mjData* d, long count, const double* q, const double* qd, const double* tau, double* qdd) {
  const int n = m->nv;
  for (long k = 0; k < count * n; k += n) {
    place(m, d, q + k);
    mj_crb(m, d);
    mj_factorM(m, d);
    move(m, d, qd + k);
    mj_rne(m, d, 0, d->qfrc_bias);
    for (int i = 0; i < n; ++i)
      d->qfrc_smooth[i] = tau[k + i] - d->qfrc_bias[i];
    mj_solveM(m, d, qdd + k, d->qfrc_smooth, 1);
  }
}
