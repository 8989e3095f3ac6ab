/* result.h - what an identification is asked and what it answers: types that every room knows
 *
 * Poles, multipliers and exponents: conventions of linear/exponents.h.  Damping ratio
 * -Re/|lambda|: positive decays.
 */
#ifndef MODAL_IDENTIFY_RESULT_H
#define MODAL_IDENTIFY_RESULT_H
#include <complex.h>
#include <stdbool.h>
#include <stddef.h>

enum rank_rule {
    RANK_AUTO,             /* candidates by several rules, the order by BIC of the fits */
    RANK_FIXED,            /* as told */
    RANK_ENERGY,           /* (A3): least r with sum_{i<=r} s_i >= energy * sum s_i */
    RANK_ENERGY_SQUARED,   /* the same with s_i^2, which is the Frobenius closeness of (A2) */
    RANK_THRESHOLD,        /* s_i > threshold * s_1 */
    RANK_GAVISH_DONOHO,   /* s_i > omega(beta) * median(s): optimal hard threshold, unknown noise */
    RANK_MDL,              /* Wax-Kailath minimum description length */
    RANK_RULE_COUNT
};
/* "auto", "fixed", "energy", "energy-squared", "threshold", "gavish-donoho", "mdl";
 * NULL-terminated. */
extern const char *const rank_rule_names[RANK_RULE_COUNT + 1];

struct rank_options {
    enum rank_rule rule;
    double energy;         /* 0: 0.9999 */
    double threshold;      /* 0: max(m,n) * DBL_EPSILON */
    int fixed;
    int most;              /* upper limit; 0: none */
};

enum identify_method {
    IDENTIFY_AUTO,                    /* partial-floquet on candidates, refined */
    IDENTIFY_PARTIAL_FLOQUET,         /* Qhat (17) */
    IDENTIFY_PARTIAL_FLOQUET_FULL,    /* Q (16) */
    IDENTIFY_AUTOREGRESSIVE,          /* Bhat (21) */
    IDENTIFY_AUTOREGRESSIVE_FULL,     /* B (20) */
    IDENTIFY_METHOD_COUNT
};
extern const char *const identify_method_names[IDENTIFY_METHOD_COUNT + 1];

enum identify_choice { CHOICE_DEFAULT, CHOICE_NO, CHOICE_YES };
enum identify_detrend { DETREND_NONE, DETREND_MEAN, DETREND_LINEAR, DETREND_COUNT };
extern const char *const identify_detrend_names[DETREND_COUNT + 1];
/* each channel to unit rms; all by one factor */
enum identify_scale { SCALE_RMS, SCALE_COMMON, SCALE_COUNT };
extern const char *const identify_scale_names[SCALE_COUNT + 1];

/* What the record answers: an excitation that is over, one that nobody measured and that lasts, or
 * one that was measured. */
enum identify_response { RESPONSE_FREE, RESPONSE_AMBIENT, RESPONSE_FORCED, RESPONSE_COUNT };
extern const char *const identify_response_names[RESPONSE_COUNT + 1];

enum {
    IDENTIFY_SAMPLES_LEAST = 8,          /* of a window, of a record, of what a band leaves of it */
    IDENTIFY_ORDER_MOST = 1600,          /* exponents looked for */
    IDENTIFY_CHANNELS_MOST = 10000000,   /* of a batch */
    IDENTIFY_INPUTS_MOST = 16,           /* measured, of a forced response */
    IDENTIFY_RECORDS_MOST = 32,          /* one after another: each has a state of its own */
    IDENTIFY_DIAGNOSTICS_MOST = 64,      /* of a result: what comes after is not added */
    IDENTIFY_TOLD = 3,                   /* of them of one code: more say the same */
    IDENTIFY_STAGES = 12                 /* whose seconds are told */
};

/* Probability that a look at a record tells of something that is not in it. */
#define IDENTIFY_ALARM 1e-4

/* window[0]: the first of the words that may stand for an interval (base/key_table.h) */
#define WINDOW_AUTO -1.0

/* Zero everywhere is the default procedure. */
struct identify_options {
    enum identify_method method;
    bool signals_all;             /* no POD: the channels themselves */
    const int *channels;          /* a choice of channels, in their order; NULL: all */
    int channel_count;
    enum identify_response response;
    const int *inputs;            /* the measured excitation, channels of the batch; forced only */
    int input_count;
    const double *starts;         /* s, rising: where further records begin; forced only */
    int start_count;
    const int *azimuth;           /* the channel that holds the angle of a periodic system, in place
                                   * of its period; NULL: none; ambient only */
    bool frf;                     /* frequency responses beside the modes; forced only */
    double pod_energy;            /* 0: rounding or noise floor */
    int pod_rank;                 /* 0: by energy */
    struct rank_options rank;
    enum identify_detrend detrend;
    enum identify_scale scale;
    int rows, columns;            /* of H0, per signal; 0: hankel_default_sizes */
    int stride;                   /* samples between columns, systems without period; 0: 1 */
    double window[2];             /* s, [t0, t1]; WINDOW_AUTO, 0: what is proposed; both 0: the
                                     whole record, of a very long one what is proposed */
    double band[2];               /* Hz; both 0: all */
    double period;                /* s; 0: the batch's; < 0: none, whatever the batch says */
    bool difference;              /* h[k+p] - h[k]: a periodic orbit removed */
    enum identify_choice refine;  /* default: yes for IDENTIFY_AUTO, else no */
    bool shapes;
    double target_error;          /* stop the ladder here; 0: none */
    double target_seconds;

    /* Of a periodic system: poles to begin with, borrowed, as a result has them. Where they are the
     * answer, refined, nothing else is searched (identify_result, begun). NULL: none are known */
    const struct identify_chosen *known;

    /* CPU seconds, for the cost of each stage; and whether to stop.  Each may be NULL. */
    double (*clock)(void *context);
    bool (*cancelled)(void *context);
    void *context;
};

struct identify_harmonic { int k; double magnitude; };

/* Where Re(exponent) > 0: neither half of the record shows it alone; one does; of a periodic system
 * both do, as steady (parts.h); the fit is exact, or the halves were too short to ask; UNASKED: a
 * periodic system's were.  NEVER: halves contradict
 * the whole, but it and both of them decay, each by three of its own standard errors.  BELOW_GRID:
 * it never reaches half a step of the grid that the samples lie on; what decays is rounded by ever
 * more of itself, and that looks like growth.  IN_CROWD: with its neighbours within a beat, and one
 * mode more, it may as well decay (another.h). */
enum growth {
    GROWTH_UNSEEN, GROWTH_IN_HALF, GROWTH_IN_HALVES, GROWTH_EXACT, GROWTH_UNASKED, GROWTH_NEVER,
    GROWTH_BELOW_GRID, GROWTH_IN_CROWD
};

struct identify_mode {
    double complex exponent;      /* principal value, Im >= 0 */
    double complex resolved;      /* + i resolved_k 2 pi / period; Im >= 0 */
    double complex multiplier;    /* over the period, or one sample as sent */
    double amplitude;             /* rms of its part over the record, channels scaled to unit rms */
    double energy;                /* its share of the modes' energy, 0..1 */
    double persistence;           /* share of orders and windows that show it; NAN: not looked */
    double residual;              /* sine of the angle between (1, rho, rho^2, ..) and the signals'
                                   * subspace; NAN: unknown */
    /* standard deviations; NAN: unknown */
    double std_re, std_im;        /* of the exponent */
    double std_multiplier, std_frequency_hz, std_damping_ratio;
    enum growth growth;
    bool harmonic;                /* of a stronger mode: it has no say in the verdict */
    double bar;             /* on |multiplier|: the largest of Jacobian, jackknife, backward pair */
    int resolved_k;
    double runner_up;             /* magnitude of the second harmonic over the first; 1: a tie */
    struct identify_harmonic *harmonics;   /* periodic systems, by descending magnitude */
    int harmonic_count;
    double complex *shape;        /* one number a channel chosen, largest 1; NULL: not asked */
    double complex *participation;       /* one number an input, beside the shape of a forced mode:
                                          * (3) of forced.c; else NULL */
    double mpc;                   /* modal phase collinearity of the shape, 0..1 */
    double cycles;                /* in the record, beside a forced response; 0: not told */
};

struct identify_candidate { int order; double bic, residual; bool refined, converged, chosen; };
struct identify_pole {
    int order;
    double complex exponent;
    double std_re, std_im;
    int mode; /* -1: none */
};
struct identify_cluster {
    double complex centroid;      /* mean multiplier */
    double radius;
    int *members; int member_count;        /* of modes */
    bool near_defective;
    bool resolved;         /* no two members' errors come near each other, however close they are */
};
struct identify_diagnostic { char code[40]; char message[640]; int channel; /* -1: none */ };
/* The strongest vibration of one part of the record. */
struct identify_window {
    double t, frequency_hz, damping_ratio, std_frequency_hz, std_damping_ratio,
        amplitude; /* t: its middle, s */
};
struct identify_stage { const char *name; double seconds; };
/*
 * Frequency responses of the model: entry (f, i, j), response i to input j at hertz[f], is
 * value[f + count (i + responses j)], units of the channels over each other; std its standard
 * deviation, that of the distance in the complex plane.  count 0: not asked.
 */
struct identify_frf {
    int count, responses, inputs;
    int *input;                   /* channels of the batch */
    double *hertz;
    double complex *value;
    double *std;
};
/* Poles over one sample as the order was chosen, listed as in exponents.h; a constant is 0. */
struct identify_chosen { double complex *lambda; int count; };

struct identify_result {
    struct identify_mode *modes; int mode_count;      /* by descending amplitude */
    double *offset;        /* per channel in its unit, where a null exponent was found; else NULL */

    enum { VERDICT_UNDECIDED, VERDICT_STABLE, VERDICT_UNSTABLE } verdict;
    bool driven;                               /* not a free decay: see not_free_decay in trend.h */
    double max_multiplier, margin, margin_std;        /* NAN where there is no mode */
    int decides;                                  /* the mode that the verdict rests on; -1: none */

    int pod_rank, hankel_rank;
    enum rank_rule rule;          /* the one that chose */
    double energy;                /* sum s_i kept by the POD or the Hankel matrix */
    double *singular; int singular_count;             /* of H0, over the first; leading ones */

    int channel_count;            /* chosen; their indices in the batch: */
    int *channel;
    double *rms_error;            /* per channel, its unit: (25) */
    double *relative_error;       /* over the channel's rms; NAN for a zero channel */
    double total_relative_error;

    struct identify_candidate *candidates; int candidate_count;
    struct identify_pole *poles; int pole_count;      /* stabilisation: every candidate's */
    struct identify_chosen chosen, unweighed;         /* those of the answer; those before channels
                                                       * were weighed by their noise (count 0: they
                                                       * were not) */
    bool begun;                   /* at options.known, and the answer was there: singular values,
                                   * candidates and poles are empty, persistence NAN */
    struct identify_cluster *clusters; int cluster_count;
    struct identify_frf frf;
    int input_count;              /* measured; 0: none */
    /* where amplitude_dependent or changes_in_record is among the diagnostics */
    struct identify_window *trend; int trend_count;
    struct identify_diagnostic diagnostics[IDENTIFY_DIAGNOSTICS_MOST]; int diagnostic_count;

    struct identify_stage stages[IDENTIFY_STAGES]; int stage_count;

    double proposed[2];           /* s: the part of the record to use; both 0: all that was asked */

    /* What the answer rests on, options after defaults. */
    struct identify_options used; /* pointers NULL */
    double period;                /* s, 0: none */
    double dt;                    /* of the samples used */
    int samples;                  /* rows used */
    int decimation, shift, rows, columns;
    bool at_grid;                 /* what is left is the rounding of the samples to their grid */
    int freedom;                  /* L - r: equations less unknowns per phase and signal */
};
#endif
