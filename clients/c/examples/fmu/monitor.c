/* monitor.c - a monitor as an FMI 2.0 co-simulation unit: what comes in goes to modald, and what
 * modald says of it comes out
 *
 * Any importer couples it like another model: the inputs u[1] ... u[n] are sampled at each step's
 * beginning and pushed as a stream; outputs are the least damped mode of the last window with its
 * standard errors, and the verdict (MODALD_UNKNOWN ... of modald_stream.h).  Until there is one the
 * outputs are 0 and the errors negative.  It never slows the simulation, and without MODALD_URL it
 * does nothing.  The standard's types are plain C, so they are written here as they are meant; n is
 * the build's (MODALD_FMU_INPUTS), as is modelDescription.xml.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modald_stream.h"

#define FMI __attribute__((visibility("default")))

enum status { OK, WARNING, DISCARD, ERROR };

/* Value references, as in modelDescription.xml. */
enum {
    DT = 1,                              /* parameters */
    WINDOW, HOP,
    FREQUENCY = 10,                      /* outputs */
    FREQUENCY_STD, DAMPING, DAMPING_STD, VERDICT,
    INPUT = 100,                         /* u[1], and so on */
};
enum { CO_SIMULATION = 1 };              /* the standard's fmi2CoSimulation */

struct monitor {
    modald_stream *stream;
    char name[129];                      /* of the stream: the instance's */
    double dt, u[MODALD_FMU_INPUTS];
    int window, hop;                     /* samples; 0: the daemon's own */
};

/* What an importer may ask for and this unit, which says so in its description, has not. */
#define HAS_NOT(name, ...) \
    FMI enum status name(__VA_ARGS__); \
    FMI enum status name(__VA_ARGS__) { return ERROR; }

HAS_NOT(fmi2GetFMUstate, void *c, void **state)
HAS_NOT(fmi2SetFMUstate, void *c, void *state)
HAS_NOT(fmi2FreeFMUstate, void *c, void **state)
HAS_NOT(fmi2SerializedFMUstateSize, void *c, void *state, size_t *size)
HAS_NOT(fmi2SerializeFMUstate, void *c, void *state, char *bytes, size_t size)
HAS_NOT(fmi2DeSerializeFMUstate, void *c, const char *bytes, size_t size, void **state)
HAS_NOT(fmi2GetDirectionalDerivative, void *c, const unsigned *of, size_t m, const unsigned *by,
        size_t n, const double *dx, double *dy)
HAS_NOT(fmi2SetRealInputDerivatives, void *c, const unsigned *r, size_t n, const int *order,
        const double *v)
HAS_NOT(fmi2GetRealOutputDerivatives, void *c, const unsigned *r, size_t n, const int *order,
        double *v)
HAS_NOT(fmi2CancelStep, void *c)
HAS_NOT(fmi2GetStatus, void *c, int kind, int *v)
HAS_NOT(fmi2GetRealStatus, void *c, int kind, double *v)
HAS_NOT(fmi2GetIntegerStatus, void *c, int kind, int *v)
HAS_NOT(fmi2GetBooleanStatus, void *c, int kind, int *v)
HAS_NOT(fmi2GetStringStatus, void *c, int kind, const char **v)
HAS_NOT(fmi2SetBoolean, void *c, const unsigned *r, size_t n, const int *v)
HAS_NOT(fmi2GetBoolean, void *c, const unsigned *r, size_t n, int *v)
HAS_NOT(fmi2SetString, void *c, const unsigned *r, size_t n, const char *const *v)
HAS_NOT(fmi2GetString, void *c, const unsigned *r, size_t n, const char **v)

FMI const char *fmi2GetVersion(void);
FMI const char *fmi2GetVersion(void)
{
    return "2.0";
}

FMI const char *fmi2GetTypesPlatform(void);
FMI const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

FMI enum status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *categories);
FMI enum status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *categories)
{
    (void)c, (void)on, (void)n, (void)categories;
    return OK;
}

FMI void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                          const void *functions, int visible, int logging);
FMI void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                          const void *functions, int visible, int logging)
{
    struct monitor *m = NULL;

    (void)resources, (void)functions, (void)visible, (void)logging;
    if (type == CO_SIMULATION && guid != NULL && strcmp(guid, MODALD_FMU_GUID) == 0)
        m = calloc(1, sizeof *m);
    if (m == NULL)
        return NULL;
    snprintf(m->name, sizeof m->name, "%s", name != NULL && name[0] != 0 ? name : "fmu");
    m->dt = 0.01;
    return m;
}

FMI enum status fmi2SetupExperiment(void *c, int bounded, double tolerance, double start,
                                    int ends, double stop);
FMI enum status fmi2SetupExperiment(void *c, int bounded, double tolerance, double start,
                                    int ends, double stop)
{
    (void)c, (void)bounded, (void)tolerance, (void)start, (void)ends, (void)stop;
    return OK;
}

FMI enum status fmi2EnterInitializationMode(void *c);
FMI enum status fmi2EnterInitializationMode(void *c)
{
    (void)c;
    return OK;
}

/* Without a daemon there is no stream, and all calls of it do nothing. */
FMI enum status fmi2ExitInitializationMode(void *c);
FMI enum status fmi2ExitInitializationMode(void *c)
{
    struct monitor *m = c;

    m->stream = modald_open(m->name, MODALD_FMU_INPUTS, m->dt);
    if (m->window > 0)
        modald_window(m->stream, m->window, m->hop > 0 ? m->hop : m->window, NULL);
    return OK;
}

/* The inputs hold at T, where the step begins; it will not be rolled back, for there is no way. */
FMI enum status fmi2DoStep(void *c, double t, double h, int final);
FMI enum status fmi2DoStep(void *c, double t, double h, int final)
{
    struct monitor *m = c;

    (void)h, (void)final;
    modald_push_at(m->stream, t, m->u);
    return OK;
}

FMI enum status fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v);
FMI enum status fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v)
{
    struct monitor *m = c;

    for (size_t i = 0; i < n; i++)
        if (r[i] >= INPUT && r[i] < INPUT + MODALD_FMU_INPUTS)
            m->u[r[i] - INPUT] = v[i];
        else if (r[i] == DT && v[i] > 0)
            m->dt = v[i];
        else
            return ERROR;
    return OK;
}

FMI enum status fmi2SetInteger(void *c, const unsigned *r, size_t n, const int *v);
FMI enum status fmi2SetInteger(void *c, const unsigned *r, size_t n, const int *v)
{
    struct monitor *m = c;

    for (size_t i = 0; i < n; i++) {
        if ((r[i] != WINDOW && r[i] != HOP) || v[i] < 0)
            return ERROR;
        *(r[i] == WINDOW ? &m->window : &m->hop) = v[i];
    }
    return OK;
}

FMI enum status fmi2GetReal(void *c, const unsigned *r, size_t n, double *v);
FMI enum status fmi2GetReal(void *c, const unsigned *r, size_t n, double *v)
{
    const struct monitor *m = c;
    struct modald_estimate e = { .frequency_std = -1, .damping_std = -1 };

    modald_get_estimate(m->stream, &e);
    const double outputs[] = { e.frequency_hz, e.frequency_std, e.damping_ratio, e.damping_std };
    for (size_t i = 0; i < n; i++)
        if (r[i] >= FREQUENCY && r[i] <= DAMPING_STD)
            v[i] = outputs[r[i] - FREQUENCY];
        else if (r[i] >= INPUT && r[i] < INPUT + MODALD_FMU_INPUTS)
            v[i] = m->u[r[i] - INPUT];
        else if (r[i] == DT)
            v[i] = m->dt;
        else
            return ERROR;
    return OK;
}

FMI enum status fmi2GetInteger(void *c, const unsigned *r, size_t n, int *v);
FMI enum status fmi2GetInteger(void *c, const unsigned *r, size_t n, int *v)
{
    const struct monitor *m = c;

    for (size_t i = 0; i < n; i++) {
        if (r[i] != VERDICT && r[i] != WINDOW && r[i] != HOP)
            return ERROR;
        v[i] = r[i] == VERDICT  ? modald_verdict(m->stream)
               : r[i] == WINDOW ? m->window
                                : m->hop;
    }
    return OK;
}

FMI enum status fmi2Terminate(void *c);
FMI enum status fmi2Terminate(void *c)
{
    struct monitor *m = c;

    modald_close(m->stream);
    m->stream = NULL;
    return OK;
}

FMI enum status fmi2Reset(void *c);
FMI enum status fmi2Reset(void *c)
{
    struct monitor *m = c;

    modald_abandon(m->stream);
    m->stream = NULL;
    memset(m->u, 0, sizeof m->u);
    return OK;
}

FMI void fmi2FreeInstance(void *c);
FMI void fmi2FreeInstance(void *c)
{
    struct monitor *m = c;

    if (m != NULL)
        modald_abandon(m->stream);
    free(m);
}
