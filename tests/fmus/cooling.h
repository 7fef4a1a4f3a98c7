/* A body that cools: T' = -k (T - ambient), T(0) = T0. One state, one event indicator (T - level).

   A start value of T, if its description lets it have one, is that of T0. The solution for a constant ambient is T = ambient + (T0 - ambient) exp(-k t), and a co-simulation
   step uses it. `trap` chooses one of the faults that simulators have. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NONE, ERROR_STATUS, RESET_FAILS, RESET_FORGETS, NOT_A_NUMBER, CRASH, DISCARD, TERMINATE };
enum { T, DER_T, T0, K, AMBIENT, LEVEL, GAS, TRAP = 10, CYCLES, BELOW, INSULATED, LABEL };

typedef struct {
    double time, real[7];
    int trap, cycles, below, insulated, stale;
    char label[32];
    void *environment, *logger;
} Body;

static void defaults(Body *b) {
    b->time = 0.0;
    b->real[T] = b->real[T0] = 400.0;
    b->real[K] = 1.0;
    b->real[AMBIENT] = 300.0;
    b->real[LEVEL] = 350.0;
    b->real[GAS] = 8.314;
    b->trap = NONE;
    b->cycles = 1;
    b->below = b->insulated = b->stale = 0;
    strcpy(b->label, "plain");
}

/* A label that is "fast" doubles the rate, so that a text can be seen to have arrived. */
static double rate(const Body *b) {
    double k = b->real[K] * b->cycles * (strcmp(b->label, "fast") == 0 ? 2.0 : 1.0);
    return b->insulated ? 0.0 : k;
}

static double derivative(const Body *b) {
    if (b->trap == NOT_A_NUMBER && b->time > 0.5) return NAN;
    return -rate(b) * (b->real[T] - b->real[AMBIENT]);
}

/* A reset that forgets to begin anew: the next run starts at the temperature of the last one. */
static int was_reset(Body *b) {
    int trap = b->trap;
    double last = b->real[T];
    if (trap == RESET_FAILS) return 0;
    defaults(b);
    b->stale = trap == RESET_FORGETS;
    b->real[T] = last;
    return 1;
}

static void initialized(Body *b) {
    if (!b->stale) b->real[T] = b->real[T0];
    b->below = b->real[T] < b->real[LEVEL];
}

static void advanced(Body *b, double step) {
    double ambient = b->real[AMBIENT];
    b->real[T] = ambient + (b->real[T] - ambient) * exp(-rate(b) * step);
    b->time += step;
    b->below = b->real[T] < b->real[LEVEL];
    if (b->trap == NOT_A_NUMBER && b->time > 0.5) b->real[T] = NAN;
}
