/* cooling.h as FMI 3.0, for co-simulation and for model exchange, reals and the trap only. */

#include "fmi3Functions.h"
#include "cooling.h"

static fmi3Status said(Body *b, fmi3Status status, const char *text) {
    ((fmi3LogMessageCallback)b->logger)(b->environment, status, "logAll", text);
    return status;
}

static fmi3Instance created(fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger) {
    Body *b = calloc(1, sizeof(Body));
    defaults(b);
    b->logger = (void *)logger;
    b->environment = environment;
    return b;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    return created(environment, logger);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t n,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    (void)events, (void)early, (void)required, (void)n, (void)update;
    return created(environment, logger);
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined,
                                       fmi3Float64 stop) {
    (void)defined, (void)tolerance, (void)stop_defined, (void)stop;
    ((Body *)c)->time = start;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { initialized(c); return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { (void)c; return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) { return was_reset(c) ? fmi3OK : fmi3Error; }

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          fmi3Float64 value[], size_t m) {
    Body *b = c;
    (void)m;
    for (size_t k = 0; k < n; k++) value[k] = vr[k] == DER_T ? derivative(b) : b->real[vr[k]];
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 value[], size_t m) {
    (void)m;
    for (size_t k = 0; k < n; k++) ((Body *)c)->real[vr[k] == T ? T0 : vr[k]] = value[k];
    return fmi3OK;
}

fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Int64 value[], size_t m) {
    Body *b = c;
    (void)m;
    for (size_t k = 0; k < n; k++) *(vr[k] == TRAP ? &b->trap : &b->cycles) = (int)value[k];
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean prior,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last) {
    Body *b = c;
    (void)prior;
    *event = *terminate = *early = false;
    *last = time;
    if (time > 0.5 && b->trap == ERROR_STATUS) return said(b, fmi3Error, "the body cracked");
    b->time = time;
    advanced(b, step);
    *last = time + step;
    *terminate = time > 0.5 && b->trap == TERMINATE;
    return fmi3OK;
}

/* Model exchange */

fmi3Status fmi3EnterEventMode(fmi3Instance c) { (void)c; return fmi3OK; }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { (void)c; return fmi3OK; }

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *needed, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *defined, fmi3Float64 *next) {
    (void)c;
    *needed = *terminate = *nominals = *values = *defined = false;
    *next = 0.0;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean prior, fmi3Boolean *event,
                                       fmi3Boolean *terminate) {
    (void)c, (void)prior;
    *event = *terminate = false;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) {
    ((Body *)c)->time = time;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) {
    if (n) ((Body *)c)->real[T] = x[0];
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    if (n) x[0] = ((Body *)c)->real[T];
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    (void)c;
    if (n) x[0] = 1.0;
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n) {
    Body *b = c;
    if (b->trap == ERROR_STATUS && b->time > 0.5) return said(b, fmi3Error, "the body cracked");
    if (n) dx[0] = derivative(b);
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n) {
    (void)c, (void)z, (void)n;
    return fmi3OK;
}
