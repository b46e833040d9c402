/* CUDA's words for a C++ compiler on the CPU. The threads of a warp take turns: each runs until it waits for the others. */
#include <cmath>
#include <cstring>
#include <cstdlib>
#include <ucontext.h>
using std::fma;
#define __device__
#define __global__
#define __noinline__ __attribute__((noinline))
#define __forceinline__ inline
#define __launch_bounds__(threads)
#define __shared__ static
struct Dimension { long long x; };
static Dimension blockIdx = {0}, blockDim = {1}, threadIdx = {0};
static inline long long __double_as_longlong(double x) { long long i; std::memcpy(&i, &x, sizeof i); return i; }
static inline double __longlong_as_double(long long i) { double x; std::memcpy(&x, &i, sizeof x); return x; }
static inline int __float_as_int(float x) { int i; std::memcpy(&i, &x, sizeof i); return i; }
static inline float __int_as_float(int i) { float x; std::memcpy(&x, &i, sizeof x); return x; }

struct Thread { ucontext_t at; void *stack; bool done; };
static Thread warp[32];
static Thread *running = nullptr;
static ucontext_t scheduler;
static void (*body)(const void *) = nullptr;
static const void *captured = nullptr;
enum { STACK = 1 << 20 };

static inline void __syncwarp() { swapcontext(&running->at, &scheduler); }

static void run_thread()
{
    body(captured);
    running->done = true;
}

/* One warp, whose first thread has an index; `backwards` lets the last thread be the first of each turn. */
static void run_warp(long long first, bool backwards)
{
    for (int k = 0; k < 32; k++) {
        Thread &each = warp[k];
        getcontext(&each.at);
        each.stack = each.stack ? each.stack : std::malloc(STACK);
        each.at.uc_stack.ss_sp = each.stack;
        each.at.uc_stack.ss_size = STACK;
        each.at.uc_link = &scheduler;
        each.done = false;
        makecontext(&each.at, run_thread, 0);
    }
    for (bool left = true; left;) {
        left = false;
        for (int k = 0; k < 32; k++) {
            const int index = backwards ? 31 - k : k;
            running = &warp[index];
            if (!running->done) {
                threadIdx.x = first + index;
                swapcontext(&scheduler, &running->at);
                left = left || !running->done;
            }
        }
    }
}

/* Blocks of some threads, warp by warp. */
template <class Kernel>
static void launch(long long blocks, long long threads, bool backwards, const Kernel &kernel)
{
    body = [](const void *each) { (*static_cast<const Kernel *>(each))(); };
    captured = &kernel;
    blockDim.x = threads;
    for (blockIdx.x = 0; blockIdx.x < blocks; blockIdx.x++) {
        for (long long first = 0; first < threads; first += 32) {
            run_warp(first, backwards);
        }
    }
    captured = nullptr;
}
