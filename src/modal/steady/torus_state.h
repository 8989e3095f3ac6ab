/* torus_state.h - what torus_tone.c, torus_set.c, torus_newton.c, torus_begin.c, torus_error.c,
 * torus_lines.c, torus_march.c, torus_stand.c, torus_from.c, torus_stability.c, torus_open.c and
 * torus_solve.c share */
#ifndef MODAL_TORUS_STATE_H
#define MODAL_TORUS_STATE_H
#include "modal/scene/program.h"
#include "modal/steady/torus_solve.h"

struct condense;
struct scene_time;
struct torus_laws;

enum {
    TORUS_UNKNOWNS_MOST = 6000,    /* what a few seconds solve for */
    TORUS_CORE_LEAST = 700,        /* 15 ms */
    TORUS_CORE_MOST = 2400,       /* of the dense derivative: 0.4 s a factorization, 46 MB */
    TORUS_POINTS_MOST = 1 << 21,   /* samples of one evaluation: of a finer grid than one solves
                                    * on */
    TORUS_FINER_MOST = 1,          /* doublings of lines: with torus_highest's, half of them */
    TORUS_CANDIDATES_MOST = 6000,  /* combinations looked at beside those kept: a few times these */
    TORUS_PARTS_MOST = 5,          /* turns of a tone that a motion is found to repeat after */
    TORUS_WAYS_MOST = 6,           /* of a body in space */
    TORUS_LOADS_MOST = 256,        /* distinct combinations of loads: more than any rig has */
};

struct torus_linear {                     /* (1) of torus_solve.h at one combination */
    double complex *S, *LU, *p;           /* q x q by columns; factors; q */
    int *pivot;                           /* pivot[0] 0: S is singular */
    int group;                            /* of the loads, 0: none */
};

/*
 * A tone of the motion's own.  Its phase is fixed by Im X = 0 at combination AT, the tone itself,
 * of dof LEAD, and the frequency takes that place among the unknowns.  While HELD, Re X there is
 * given too, and its place is a gain's: of i gain k_j damping[i] X, j the tone, added to (1) of
 * torus_solve.h, which is what a damper of the tone alone does.
 */
struct torus_tone {
    int index;                            /* which of the tones; -1: none is free */
    int lead, at;
    bool held;
    double gain;                          /* with s->tones: of the motion tried */
    double omega_kept, gain_kept;         /* at s->X */
    double unit;                          /* 1 / |X|: a place's worth of gain, and of omega over
                                           * itself */
    double *damping;                      /* q */
    double complex *by_omega, *by_gain;   /* [i count + m]: of the balance, times their units */
};

struct torus_solver {
    struct program view;                  /* the program with the loads of one combination */
    const struct program *p;
    const struct torus_options *opt;
    struct torus_tones tones;
    struct budget *work;
    struct torus_tone tone;
    int groups;                           /* of loads, 1 ..; 0 has none */
    struct torus_index group[TORUS_LOADS_MOST + 1];
    struct condense *condense[TORUS_LOADS_MOST + 1];
    int q, count;                         /* dofs that iterate, combinations */
    struct torus_index *index;
    struct torus_linear *linear;
    double complex *X, *F, *R, *was;      /* [i count + m]; was: X before the set grew last */
    double level;                         /* what loads are multiplied by */
    int ways, open;                       /* directions that the structure's own S_0 leaves open;
                                           * those along which s->X may be moved by a constant
                                           * and no law answers */
    double *way, *unit;                   /* [way][dof of q]; a dof's root of the stiffness at the
                                           * leading tone: the ways times these are of length 1 */
    struct torus_laws *laws;
    struct torus_grid *grid;
    int finer;                            /* doublings of the lines beyond what the set needs */
    int core;                             /* combinations of the dense derivative */
    double *J;                            /* it, factored */
    int *pivot;
    double making;                        /* budget.h: what J cost, */
    double asking;                        /* what forces of the set did, */
    double ahead;                         /* what an estimate of the balance will: Newton's steps
                                           * leave it */
    bool told;                            /* an estimate follows */
    double complex *outer;                /* of the other combinations, q x q: S with the laws'
                                           * mean slopes, factored */
    int *outer_pivot;
    struct torus_part part;               /* what the march repeats after, found by it */
    int marched;                          /* samples of the record that X was read from; 0: X
                                           * balances its set */
    struct torus_stability followed;      /* of the march that X was read from; count 0: none */
    int iterations;
    double rough;                         /* relative: where Newton may stop; 0: as opt asks */
    double step, residual;                /* the last, relative */
    const char *reason;                   /* why not converged */
};

/* The error asked for, of the amplitude: as with one tone where none is. */
static inline double torus_target(const struct torus_solver *s)
{
    return s->opt->target_error > 0 ? s->opt->target_error : 1e-6;
}

/* A combination beside the set, and the motion that its force makes. */
struct torus_candidate { struct torus_index k; double size; double complex *X; };

/* Of X, in m: left out, as torus_error.c has it; what that makes of itself; beyond: what of it is
 * past all grids, however the set grows; of samples; of a record's the same of a single line.
 * tone: rad/s. */
struct torus_errors { double truncation, change, beyond, sampling, solver, tone, line, folded; };

/* A motion read from a march: as s->index and s->X, errors in m. */
struct torus_lines {
    int count, samples, turns;            /* 0: none */
    struct torus_index *index;
    double complex *X;
    struct torus_errors e;                /* change: what is seen of the truncation */
    double apart;                         /* rad/s: nearer combinations are one line */
    double error, amplitude;              /* of all together; of the reported dofs */
    double line;                          /* of a line, told or not */
    bool *acts;                           /* of laws, in a march from the scene's start; or NULL */
    long asked;                           /* and how often each was */
};

/* ---- torus_tone.c ---- */

/* The place among the set's motion that its frequency takes; a tone is free. */
size_t torus_tone_place(const struct torus_solver *s);
/* X without what is no motion there, which is returned: gain and frequency, in units. */
double complex torus_tone_take(const struct torus_solver *s, double complex *x);
/* The free tone at OMEGA, under GAIN: tones, laws, grid and linear parts. */
enum modal_status torus_tone_move(struct torus_solver *s, double omega, double gain,
                                  struct modal_error *err);
/* What was tried last is where s->X is. */
void torus_tone_keep(struct torus_solver *s);
/* The set with the signs of torus.h's (1), which may have turned as the tone moved; *TURNED: some
 * had. */
enum modal_status torus_tone_told(struct torus_solver *s, bool *turned, struct modal_error *err);

/* ---- torus_set.c ---- */

/* The loads' combinations into s->group; MODAL_BAD_INPUT for what is no harmonic of tones. */
enum modal_status torus_read_loads(struct torus_solver *s, struct modal_error *err);
/* s->condense[G]: the linear part with the loads of group G as harmonic 1, or 0, of whatever
 * frequency is asked for. */
enum modal_status torus_new_group(struct torus_solver *s, int g, struct modal_error *err);
/* Whose loads are at K; 0: none. */
int torus_group(const struct torus_solver *s, struct torus_index k);
/* What condense_at takes as omega for harmonic 1 to be combination K, or 0 to be the mean. */
double torus_base(const struct torus_solver *s, struct torus_index k);
/* What that costs, in budget.h's units. */
double torus_linear_work(const struct torus_solver *s);
/* What a step of a march over TIME costs: *LEAPS: one of stages, each as sparse as the program;
 * else products with a map, which is made anew where an event cuts the step. */
double torus_step_work(const struct torus_solver *s, const struct scene_time *time, bool *leaps);
/* S, its factors and p at combination K, at level 1; torus_linear_done frees them. */
enum modal_status torus_linear_at(struct torus_solver *s, struct torus_index k,
                                  struct torus_linear *l, struct modal_error *err);
void torus_linear_done(struct torus_linear *l);
/* x <- S_k^-1 x; as it is where S_k is singular. */
void torus_linear_solve(const struct torus_solver *s, const struct torus_linear *l,
                        double complex *x);
bool torus_in_set(const struct torus_solver *s, struct torus_index k);
/* Unknowns of all combinations of at most ORDER, and those of the loads. */
double torus_unknowns(const struct torus_solver *s, int order);
/* The motion on count + ADDED combinations, the new ones, MORE, at rest. */
enum modal_status torus_grow(struct torus_solver *s, const struct torus_index *more, int added,
                             struct modal_error *err);
/* All combinations of at most ORDER, by rising order, and those of the loads.  MODAL_TOO_LARGE past
 * TORUS_UNKNOWNS_MOST. */
enum modal_status torus_grow_to_order(struct torus_solver *s, int order, struct modal_error *err);
/* The most of |k_j| that a grid serves which can still be made finer. */
int torus_highest(const struct torus_solver *s, int j);
/* A grid for the set, FINER doublings of all, LINES_FINER of the lines beyond: its samples; it;
 * MODAL_TOO_LARGE where these are more than TORUS_POINTS_MOST. */
double torus_grid_size(const struct torus_solver *s, int finer, int lines_finer);
enum modal_status torus_grid_for(const struct torus_solver *s, int finer, int lines_finer,
                                 struct torus_grid **out, struct modal_error *err);

/* How many combinations beside the set an estimate looks at, on a grid of LINES times those of the
 * last forces: each asks for its linear part and for its share of every event. */
int torus_looked_at(const struct torus_solver *s, double lines);
/* Whether a reported dof is none that iterates. */
bool torus_reports_others(const struct torus_solver *s);
/* What torus_estimate costs, in budget.h's units, after forces of the set's motion on s->grid; its
 * own steps end with the work. */
double torus_estimate_work(const struct torus_solver *s);

/* ---- torus_newton.c ---- */

/* x <- P^-1 x, P the preconditioner at the last iterate; x of the set's motion. */
void torus_precondition(const struct torus_solver *s, double complex *x);
/* J x = b at s->X, whose forces are s->F, B preconditioned. */
enum modal_status torus_newton_step(struct torus_solver *s, const double complex *b,
                                    double complex *x, struct modal_error *err);
/* s->X that balances the set on s->grid: from where it is, from a march, along the loads' level;
 * *CONVERGED false: the best, with s->reason. */
enum modal_status torus_solve_set(struct torus_solver *s, bool *converged, struct modal_error *err);

/* The program's own motion from its initial state once START has passed, of the kept dofs, sample
 * by sample. */
enum modal_status torus_record(struct torus_solver *s, struct scene_time *time, double *signals,
                               struct modal_error *err);
/* X[i columns + c] of least squares, c of the set's combinations the mean, then Re and Im of each,
 * over ROWS of a record; *LEFT: the root of what squares are left.  X NULL: *LEFT alone. */
enum modal_status torus_fit(const struct torus_tones *t, int count, const struct torus_index *index,
                            const struct scene_time *time, int q, const double *signals,
                            double complex *X, double *left, struct modal_error *err);

/* ---- torus_march.c ---- */

/* Whether a march may know more than a balance: of laws with events that the balanced motion meets,
 * and of any where none was found (BALANCED false: tones of a common period may have a motion at
 * their own phases and none at others), all sliders moving, for one at rest is left anywhere; no
 * tone is free, and neither the set nor the branch is given. */
bool torus_march_takes(const struct torus_solver *s, bool balanced);
/*
 * The motion marched from where s->X has it, BALANCED, or from the scene's start, and its lines
 * read, until their error is WANTED of the amplitude, a longer record tells no more, or the work
 * allowed is spent: those of the longest record into BEST.
 */
enum modal_status torus_march(struct torus_solver *s, double wanted, bool balanced,
                              struct torus_lines *best, struct modal_error *err);
/*
 * The same in pieces that are followed exactly (torus_pieces.h), from the scene's start and once
 * what it began with has decayed; BEST stays empty where the scene is not of that kind or does not
 * settle; and where a slider comes to rest, unless there are too many dofs for a balance, which
 * chooses its place.  s->followed is of it, and s->part: laws that open and close may have what
 * decays repeat after some turns of a tone alone, with lines that are none of the tones'.
 */
enum modal_status torus_march_exactly(struct torus_solver *s, double wanted,
                                      struct torus_lines *best, struct modal_error *err);

/* ---- torus_stand.c ---- */

/* Whether LINES are an answer: they explain what was marched, or POINT's motion, that of s->X,
 * better than it does; POINT NULL: none. */
bool torus_lines_stand(const struct torus_solver *s, const struct torus_lines *lines,
                       const struct torus_point *point);
/* LINES as s->index and s->X, and their errors as OUT's; LINES is empty then.  S has no linear
 * parts any more, for only a balance asks for them: a thousand lines would be as many
 * factorizations. */
void torus_adopt(struct torus_solver *s, struct torus_lines *lines, double wanted,
                 struct torus_point *out);
void torus_lines_done(struct torus_lines *lines);
/* Whether LINES are of the motion that s->X balances in part: of its combinations they are off by
 * no more than a few times what they have beside them, for what is left out changes the rest by
 * about as much as it is. */
bool torus_lines_agree(const struct torus_solver *s, const struct torus_lines *lines);

/* ---- torus_begin.c ---- */

/* Of a free tone: its frequency, the first set and a motion near one that balances it; *BEGUN
 * false: none was found, with s->reason. */
enum modal_status torus_begin(struct torus_solver *s, bool *begun, struct modal_error *err);

/* ---- torus_from.c ---- */

/* The set of at most ORDER, with what opt->start has beside unless that order was asked for, and
 * the start's motion on it; a free tone is where the start has it. */
enum modal_status torus_begin_from(struct torus_solver *s, int order, struct modal_error *err);

/* ---- torus_stability.c ---- */

/* The exponents and the verdict of GROWTH, logarithms of what each of COLUMNS disturbances grew by
 * in TURNS turns, [turn][column]. */
void torus_judge_growth(const struct torus_solver *s, const double *growth, int turns, int columns,
                        struct torus_stability *out);
/* Why a motion is not called stable though all that is followed decays. */
#define TORUS_RESTS "a slider comes to rest, and no disturbance of its place decays"
/* Of s->X's disturbances, without combinations that sum to LEAVE, in m; PLACE as condense_place
 * has it.
 * *MISSED: the system's own motion leaves that of a balance by so much at least, in m; 0 where
 * disturbances grow anyway, and where it is not followed. */
enum modal_status torus_judge(struct torus_solver *s, const int *place, struct torus_stability *out,
                              double leave, double *missed, struct modal_error *err);

/* ---- torus_open.c ---- */

/* s->ways, of S->q dofs. */
enum modal_status torus_find_ways(struct torus_solver *s, struct modal_error *err);
/* s->open, at s->X. */
enum modal_status torus_open(struct torus_solver *s, struct modal_error *err);

/* ---- torus_error.c ---- */

/* X[i count + m] of COUNT dofs DOFS, kept or reported, of the set's motion and its loads, into
 * X. */
enum modal_status torus_recover(struct torus_solver *s, int count, const int *dofs,
                                double complex *X, struct modal_error *err);
/* max |x| over G's samples and the reported dofs of what the kept ones' motion D, COUNT
 * combinations INDEX, makes of them. */
enum modal_status torus_largest(struct torus_solver *s, struct torus_grid *g, int count,
                                const struct torus_index *index, const double complex *D,
                                double *most, struct modal_error *err);
/* The errors at s->X, the motion's size, and *COUNT candidates by falling size into LIST, room for
 * TORUS_CANDIDATES_MOST, their motions in ROOM, as many times q. */
enum modal_status torus_estimate(struct torus_solver *s, struct torus_candidate *list, int *count,
                                 double complex *room, struct torus_errors *e, double *amplitude,
                                 struct modal_error *err);
#endif
