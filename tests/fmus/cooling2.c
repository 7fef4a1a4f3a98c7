/* cooling.h as FMI 2.0, for co-simulation and for model exchange. */

#include <stdio.h>

#include "fmi2Functions.h"
#include "cooling.h"

static fmi2Status said(Body *b, fmi2Status status, const char *text) {
    const fmi2CallbackFunctions *functions = b->logger;
    functions->logger(b->environment, "cooling", status, "logAll", "%s (k = %g)", text, b->real[K]);
    return status;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    const char *left = getenv("COOLING_LICENSES");  /* kept there: the library is loaded anew */
    char less[16];
    if (left && atoi(left) == 0) return NULL;
    if (left) snprintf(less, sizeof less, "%d", atoi(left) - 1), setenv("COOLING_LICENSES", less, 1);
    Body *b = calloc(1, sizeof(Body));
    (void)name, (void)type, (void)guid, (void)resources, (void)visible, (void)logging;
    defaults(b);
    b->logger = (void *)functions;
    b->environment = functions->componentEnvironment;
    return b;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    (void)defined, (void)tolerance, (void)stop_defined, (void)stop;
    ((Body *)c)->time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { initialized(c); return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return was_reset(c) ? fmi2OK : fmi2Error; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Body *b = c;
    for (size_t k = 0; k < n; k++) value[k] = vr[k] == DER_T ? derivative(b) : b->real[vr[k]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
    for (size_t k = 0; k < n; k++) ((Body *)c)->real[vr[k] == T ? T0 : vr[k]] = value[k];
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Integer value[]) {
    Body *b = c;
    for (size_t k = 0; k < n; k++) value[k] = vr[k] == TRAP ? b->trap : b->cycles;
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Integer value[]) {
    Body *b = c;
    for (size_t k = 0; k < n; k++) *(vr[k] == TRAP ? &b->trap : &b->cycles) = value[k];
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Boolean value[]) {
    Body *b = c;
    for (size_t k = 0; k < n; k++) value[k] = vr[k] == BELOW ? b->below : b->insulated;
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Boolean value[]) {
    (void)vr;
    for (size_t k = 0; k < n; k++) ((Body *)c)->insulated = value[k];
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                         const fmi2String value[]) {
    (void)vr;
    for (size_t k = 0; k < n; k++) strncpy(((Body *)c)->label, value[k], 31);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean prior) {
    Body *b = c;
    (void)prior;
    if (time > 0.5) {
        if (b->trap == ERROR_STATUS) return said(b, fmi2Error, "the body cracked");
        if (b->trap == DISCARD || b->trap == TERMINATE) return fmi2Discard;
        if (b->trap == CRASH) abort();
    }
    b->time = time;
    advanced(b, step);
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    (void)kind;
    *value = ((Body *)c)->time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)kind;
    *value = ((Body *)c)->trap == TERMINATE;
    return fmi2OK;
}

/* Model exchange */

fmi2Status fmi2EnterEventMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { (void)c; return fmi2OK; }

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    Body *b = c;
    memset(info, 0, sizeof *info);
    b->below = b->real[T] < b->real[LEVEL];
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean prior, fmi2Boolean *event,
                                       fmi2Boolean *terminate) {
    Body *b = c;
    (void)prior;
    *event = fmi2False;
    *terminate = b->trap == TERMINATE && b->time > 0.5;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    ((Body *)c)->time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    if (n) ((Body *)c)->real[T] = x[0];
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    if (n) x[0] = ((Body *)c)->real[T];
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    (void)c;
    if (n) x[0] = 1.0;
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n) {
    Body *b = c;
    if (b->trap == ERROR_STATUS && b->time > 0.5) return said(b, fmi2Error, "the body cracked");
    if (n) dx[0] = derivative(b);
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n) {
    Body *b = c;
    if (n) z[0] = b->real[T] - b->real[LEVEL];
    return fmi2OK;
}
