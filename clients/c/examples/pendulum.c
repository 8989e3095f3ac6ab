/* pendulum.c - a MuJoCo loop with the calls of modald_stream.h, beside MuJoCo's own linearisation
 *
 * Three links hang from a hinge, the lower two held by springs, all damped; the joints' angles are
 * the stream.
 *
 * usage: example_pendulum NAME STEPS
 * stdout: the time step, then the matrix of transition over one step by mjd_transitionFD, a row a
 * line: its eigenvalues z are the modes, lambda = ln z / step.
 */
#include <mujoco/mujoco.h>
#include <stdio.h>
#include <stdlib.h>
#include "modald_stream.h"

enum { STATES = 6 };           /* an angle and its rate a link */

#define LINK(at, stiffness) \
    "<body pos='0 0 " at "'><joint type='hinge' axis='0 1 0' damping='0.02' stiffness='" stiffness \
    "'/><geom type='capsule' fromto='0 0 0 0 0 -0.5' size='0.02' mass='1'/>"

static const char model[] =
    "<mujoco><option timestep='0.002' integrator='implicit' gravity='0 0 -9.81'/><worldbody>"
    LINK("2", "0") LINK("-0.5", "3") LINK("-0.5", "3")
    "</body></body></body></worldbody></mujoco>";

/* MuJoCo reads models from files; its virtual ones spare us a path. */
static mjModel *load(char *why, int room)
{
    static mjVFS files;
    mjModel *m;

    mj_defaultVFS(&files);
    if (mj_makeEmptyFileVFS(&files, "pendulum.xml", sizeof model - 1) != 0)
        return NULL;
    for (size_t i = 0; i < sizeof model - 1; i++)
        ((char *)files.filedata[0])[i] = model[i];
    m = mj_loadXML("pendulum.xml", &files, why, room);
    mj_deleteVFS(&files);
    return m;
}

static void print_transition(const mjModel *m, mjData *d)
{
    double A[STATES * STATES];

    mjd_transitionFD(m, d, 1e-6, 1, A, NULL, NULL, NULL);
    printf("%.17g\n", m->opt.timestep);
    for (int i = 0; i < STATES * STATES; i++)
        printf("%.17g%c", A[i], i % STATES == STATES - 1 ? '\n' : ' ');
}

int main(int argc, char **argv)
{
    char why[500] = "";
    long steps = argc > 2 ? atol(argv[2]) : 10000;
    mjModel *m = load(why, sizeof why);
    mjData *d = m != NULL ? mj_makeData(m) : NULL;

    if (d == NULL) {
        fprintf(stderr, "%s\n", why);
        return 1;
    }
    print_transition(m, d);
    d->qpos[0] = 2e-5;                 /* rad: what is not linear is 1e-10 of it */
    d->qpos[2] = -1e-5;
    modald_stream *s = modald_open(argc > 1 ? argv[1] : "pendulum", m->nq, m->opt.timestep);
    for (long k = 0; k < steps; k++) {
        mj_step(m, d);
        modald_push(s, d->qpos);
    }
    modald_close(s);
    mj_deleteData(d);
    mj_deleteModel(m);
    return 0;
}
