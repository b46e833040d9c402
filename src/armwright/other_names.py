"""Names of other toolboxes (Pinocchio, MuJoCo, Robotics Toolboxes, Drake) with their names in Armwright."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

OTHERS = {  # the name here → theirs, in small letters and without underscores
    "inverse_dynamics": "rnea rne mjinverse calcinversedynamics id",
    "forward_dynamics": "aba accel mjforward fd calcforwarddynamics",
    "mass_matrix": "crba inertia mjfullm calcmassmatrix",
    "gravity_torques": "gravload gravitytorque computegeneralizedgravity calcgravitygeneralizedforces",
    "bias_torques": "nonlineareffects nle qfrcbias",
    "coriolis_matrix": "coriolis computecoriolismatrix velocityproduct calcbiasterm",
    "forward_kinematics": "fkine fk gettransform framesforwardkinematics calcrelativetransform",
    "inverse_kinematics": "ikine ik iklm ikgn ikine6s ikinelm",
    "jacobian": "jacob0 geometricjacobian computeframejacobian computejointjacobians mjjac calcjacobianspatialvelocity",
    "inverse_dynamics_derivatives": "computernederivatives computerneaderivatives",
    "forward_dynamics_derivatives": "computeabaderivatives mjdtransitionfd",
    "regressor": "computejointtorqueregressor",
    "operational_inertia": "opspaceinertia",
    "energy": "computetotalenergy",
    "centre_of_mass": "centerofmass com",
    "load": "buildmodelfromurdf importrobot loadrobot rigidbodytree seriallink ertdhrobot robot",
    "compile": "compilearm",
    "simulate": "mjstep fdyn ode45",
    "manipulability": "maniplty",
    "show": "teach plotrobot meshcatvisualizer",
    "state_space": "linearise linearize linearmodel ss",
    "follow_path": "ctraj cartesiantrajectory",
    "Trapezoid": "lspb trapveltraj trapezoidal",
    "Quintic": "jtraj quinticpoly quinticpolytraj",
    "Cubic": "cubicpolytraj",
}  # fmt: skip
OF_ARM = {  # of an arm: what is here → others' attributes
    "n": "dof ndof nq nv njoints numjoints",
    "names": "joints jointnames",
    "bodies": "links",
    "tip": "ee endeffector tool tcp",
    "parameters": "mass masses inertias",
    "with_payload(…)": "payload addbody",
    "aw.show(arm, …)": "plot",
    "aw.simulate(aw.Scenario(arm, …))": "simulate fdyn ode45",
    "aw.trajectories.MotionLimits.of(arm)": "limits qlim qlimits jointlimits",
}
KEYWORDS = {  # likewise, of arguments by keyword: the name here → theirs
    "near": "q0 q_init qinit initial_guess guess seed x0 start",
    "tolerance": "tol eps atol",
    "frame": "end ee link endeffector tool",
    "aim": "mask we weights",
    "targets": "pose poses target t goal_pose",
}  # fmt: skip
HERE = {other: name for name, others in OTHERS.items() for other in (*others.split(), name.replace("_", "").lower())}
HERE_OF_ARM = {other: name for name, others in OF_ARM.items() for other in others.split()}
HERE_IT_IS = "; here it is "  # before the name, at the end of an error
ELSEWHERE = ("load", "manipulability", "state_space", "follow_path", "simulate")  # not called aw.NAME(arm, …)


def advice(name: str, known: Iterable[str]) -> str:
    """The end of an error about an unknown name: its name in Armwright, or nothing.

    Args:
        name: that is unknown.   known: the names that there are, those of groups as GROUP.NAME.
    """
    here = (HERE.get(name.replace("_", "").lower(), ""), name)
    found = next((each for each in known if each.rpartition(".")[2] in here), "")
    return f"{HERE_IT_IS}{found}" if found else ""


def advice_of_arm(name: str) -> str:
    """The end of an error about an attribute that an arm lacks: what has it here, or nothing."""
    plain = name.replace("_", "").lower()
    function = HERE.get(plain, "")
    if function.islower() and function not in ELSEWHERE:
        return f"{HERE_IT_IS}aw.{function}(arm, …)"
    return f"{HERE_IT_IS}{HERE_OF_ARM[plain]}" if plain in HERE_OF_ARM else ""


def answering(function: Callable[P, R]) -> Callable[P, R]:
    """The function with errors that translate unknown keywords of other toolboxes.

    Raises:
        TypeError: such a keyword; names the one here.
    """
    here = {other: name for name, others in KEYWORDS.items() for other in others.split()}

    @wraps(function)
    def answered(*args: P.args, **kwargs: P.kwargs) -> R:
        for name in kwargs:
            if name in here:
                raise TypeError(f"{function.__name__}() has no argument {name!r}; here it is {here[name]!r}")
        return function(*args, **kwargs)

    return answered
