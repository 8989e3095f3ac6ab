/* keys.c - see keys.h; a job refuses what is not its own, so this table is for people alone */
#include "keys.h"
#include <string.h>

static const struct { const char *kind, *key, *help; } keys[] = {
    { "identify", "method=NAME",         "auto, partial-floquet, partial-floquet-full, autoregressive, autoregressive-full" },
    { "identify", "signals=pod|all|A,B", "reduced by proper orthogonal modes (default), all channels, or those named" },
    { "identify", "window=T0,T1",        "seconds of the record to use" },
    { "identify", "band=F1,F2",          "hertz: demodulated, filtered and decimated first" },
    { "identify", "period=T",            "seconds, of a periodic system; 0: constant coefficients, whatever the batch says" },
    { "identify", "difference=true",     "h(t + T) - h(t): takes a periodic orbit off first" },
    { "identify", "detrend=none|mean|linear", "taken off each channel first" },
    { "identify", "scale=rms|common",    "each channel to unit rms, or all by one factor" },
    { "identify", "rank.fixed=N",        "the number of exponents: two a pair, one a real or constant part" },
    { "identify", "rank.rule=NAME",      "auto, fixed, energy, energy-squared, threshold, gavish-donoho or mdl" },
    { "identify", "rank.energy=X",       "share of the singular values that energy rules keep" },
    { "identify", "rank.threshold=X",    "singular values above X of the largest" },
    { "identify", "rank.most=N",         "the highest order tried" },
    { "identify", "pod.rank=N",          "proper orthogonal modes kept" },
    { "identify", "pod.energy=X",        "or their share of the energy" },
    { "identify", "rows=N",              "of the Hankel matrix, per signal" },
    { "identify", "columns=N",           "of the Hankel matrix" },
    { "identify", "stride=N",            "samples between two columns" },
    { "identify", "refine=true|false",   "variable projection after the method; error bars come from it" },
    { "identify", "shapes=true",         "mode shapes over the channels" },
    { "identify", "target.error=X",      "the cheapest settings whose error is below X" },
    { "identify", "target.seconds=S",    "the best settings within S seconds" },
    { "identify", "threads=N",           "of BLAS (default 1)" },
    { "steady",   "harmonics=N",         "of each dof; default: what target.error needs" },
    { "steady",   "samples=N",           "of one period, for forces in time" },
    { "steady",   "target.error=X",      "relative, that default harmonics reach (1e-6)" },
    { "steady",   "method=auto|direct|newton", "how the balance is solved" },
    { "steady",   "tolerance=X",         "of the balance (1e-12)" },
    { "steady",   "max_iterations=N",    "then the best so far is the answer, not converged" },
    { "steady",   "cutoff=X",            "harmonics below X of the largest are left out" },
    { "steady",   "relaxation=X",        "of direct iteration, up to 1" },
    { "steady",   "located=true|false",  "reversals and contacts located inside the sample (default true)" },
    { "steady",   "differences=true",    "Newton by difference quotients, as in the paper" },
    { "steady",   "subharmonic=N",       "the fundamental is omega / N" },
    { "steady",   "solutions=one|all",   "all: several starts, no duplicates" },
    { "steady",   "stability=true|false","multipliers of the orbit (default true)" },
    { "steady",   "time=true|N",         "the waveform too, in N samples" },
    { "steady",   "dofs=A,B",            "those reported" },
    { "steady",   "start={\"A\":{\"k\":[1],\"re\":[1],\"im\":[0]}}", "where to begin" },
    { "steady",   "backbone=MODE:A:B[:N]", "the free vibration of a mode from amplitude A to B, in N points, in place of the forced one" },
    { "steady",   "threads=N",           "of BLAS (default 1)" },
    { "simulate", "integrator=auto|rk4", "auto: exact exponentials and maps where the scene is linear" },
    { "simulate", "tolerance=X",         "of the adaptive parts" },
    { "simulate", "substeps=N",          "of rk4 in one sample" },
    { "simulate", "without=I,J",         "leave these effects of the scene out" },
    { "simulate", "elements=N",          "another mesh, with the same places and channels" },
    { "simulate", "inflow_states=N",     "of the airloads, in place of the scene's" },
    { "simulate", "threads=N",           "of BLAS (default 1)" },
    { "floquet",  "tolerance=X",         "of the monodromy matrix (1e-12)" },
    { "floquet",  "hill=true|false",     "Hill's determinant as a second, independent way (default true)" },
    { "floquet",  "hill.harmonics=N",    "of it; default: until its truncation is small" },
    { "floquet",  "threads=N",           "of BLAS (default 1)" },
    { "tradeoff", "repetitions=N",       "of each rung; its time is their median" },
    { "tradeoff", "target.error=X",      "stop at the first rung below X" },
    { "tradeoff", "target.seconds=S",    "climb no longer than this" },
    { "tradeoff", "truth=[[RE,IM],…]",   "of identify: the exponents that errors are against; default: the best rung's" },
    { "tradeoff", "(those of identify)", "of identify: held on every rung" },
    { "tradeoff", "stability=true|false","of steady" },
    { "tradeoff", "threads=N",           "of BLAS (default 1)" },
    { "sweep",    "first=I",             "the first point of a share" },
    { "sweep",    "count=N",             "the points in it" },
    { "sweep",    "threads=N",           "of BLAS (default 1)" },
    { "ablate",   "(those of steady)",   "where the scene has harmonic excitation" },
    { "ablate",   "threads=N",           "of BLAS (default 1)" },
    { "stream",   "(those of identify)", "for the live windows" },
};

void keys_help(FILE *to, const char *kind)
{
    const char *title = "\n-o KEY=VALUE, all in the result with their defaults:\n";

    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        if (strcmp(keys[i].kind, kind) == 0) {
            fprintf(to, "%s  %-28s %s\n", title, keys[i].key, keys[i].help);
            title = "";
        }
}
