/* law.h - a local nonlinear force: one table of functions a kind, the same for steady states and
 * for stepping
 *
 * A law reads displacements along given directions, d[i] = sum over the ends of input i of weight
 * x[dof], and their rates, and gives the forces f[i] with which it resists: (1) of program.h has
 * +weight f[i] on each of those dofs.  Between two dofs the ends are (dof, 1) and (to, -1); the
 * ground is no end.
 */
#ifndef MODAL_LAW_H
#define MODAL_LAW_H
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"

enum {
    LAW_INPUTS_MOST = 4,               /* dofs of a polynomial's term: slopes grow by its square */
    LAW_PIECE_INPUTS = 2,              /* of laws with pieces: a contact in the plane */
    LAW_ENDS_MOST = 64,                /* of an input; chosen: each is coupled with each other */
    LAW_TERMS_MOST = 64,               /* sliders, coefficients; chosen: each is summed each time */
    LAW_SOURCE_MOST = 65536,           /* bytes, chosen: a thousand lines of a user's law */
    LAW_LUA_MOST = 8 << 20,            /* bytes, chosen: hundreds of empty states */
    LAW_LUA_TOGETHER_MOST = 128 << 20, /* bytes, chosen: sixteen laws at their most */
};

struct law;
struct orbit;
struct law_pieces;

struct law_point {                    /* one instant, reached from the one before */
    double t;                         /* s */
    const double *d, *v;              /* inputs each, now */
    /* `memory` doubles at the step's start; zeros at the very start */
    const double *memory_before;
};

/* Of its inputs every entry is written by each call, whatever stood there; but for fd and fv of a
 * user's law where they are not wanted. */
struct law_force {
    /* in: slopes are not wanted, and those of a user's law, which are dear, are not made */
    bool alone;
    double f[LAW_INPUTS_MOST];  /* N, one an input */
    /* df_i/dd_j, exact, memory_before held */
    double fd[LAW_INPUTS_MOST][LAW_INPUTS_MOST];
    double fv[LAW_INPUTS_MOST][LAW_INPUTS_MOST];   /* df_i/dv_j */
    double *memory;                                /* out: `memory` doubles after the step */
    /* slipping, in contact, ... : not in its rest regime */
    bool acts;
    int regime; /* which smooth piece this is: within one, f is analytic; 0 for smooth
                                                    * laws (stepping locates the instants where it
                                                    * changes) */
    /* of a user's law that failed: since it is not finite at a larger d or v than those of a whole
     * period, not of rest, in which it was */
    bool beyond;
};

struct law_class {
    const char *name;
    int inputs;                       /* 1 to LAW_INPUTS_MOST; with pieces LAW_PIECE_INPUTS */
    bool reads_velocity, reads_time;  /* else f is of d alone */
    bool smooth;                      /* analytic in d and v: no events to locate */
    /* inputs (y, z) of one place: f(R d, R v) = R f(d, v) for every rotation R */
    bool turns;
    /* rigid Coulomb: at v = 0 any f in [-limit, limit]; `force` gives 0 there */
    bool set_valued;
    enum modal_status (*force)(const struct law *law, const struct law_point *at,
                               struct law_force *out, struct modal_error *err);
    /* Of a smooth law of one input that remembers nothing: f at (d, v) alone, as `force` has it,
     * for who steps and asks for no slopes; NULL: of others. */
    double (*alone)(const struct law *law, double d, double v);
    /* The exact force of a periodic motion, cut at its events (pieces.h); NULL: the law is
     * sampled. */
    enum modal_status (*pieces)(const struct law *law, const struct orbit *const *input,
                                struct law_pieces *out, struct modal_error *err);
    /* Whether a motion of inputs within mean +- reach stays in the regime of rest, which must be
     * linear (law_rest); NULL: never known. */
    bool (*stays)(const struct law *law, const double *mean, const double *reach);
    /* Of a law of sliders: its stiffest spring, N/m; and OUT, grounded, its like with none stiffer
     * than MOST, law_done's.  NULL, both: of others.  Contacts that open have none: softer ones
     * push a body that nothing else holds to where they just touch it, one of its many means. */
    double (*stiffest)(const struct law *law);
    enum modal_status (*soften)(const struct law *law, double most, struct law *out,
                                struct modal_error *err);
    /* The start of a period: forget every call before it (memory of a user's law); NULL: nothing
     * to forget. */
    void (*restart)(const struct law *law);
    /* With `restart`: whether anything has been kept since.  One that keeps nothing is a
     * function of t, d and v alone. */
    bool (*remembers)(const struct law *law);
    void (*free)(struct law *law);    /* of law->data; NULL: free() */
};

struct law_end { int dof; double weight; };

struct law {
    const struct law_class *kind;  /* NULL: no law */
    int effect;                       /* row of program.effect */
    struct law_end *end;              /* of input i: end[start[i]] .. end[start[i + 1] - 1] */
    int start[LAW_INPUTS_MOST + 1];
    int memory;                       /* doubles of state (iwan: one a slider) */
    int degree;                       /* of the force as a polynomial in d and v; 0: none */
    double limit;                     /* of friction: no force exceeds it, N; 0: of other laws */
    void *data;                       /* its numbers, as its class lays them out */
};

/*
 * Constructors: each fills *OUT but for `effect` and its ends, which the caller adds (until then
 * it sees the ground alone). Numbers are copied.  Fails with MODAL_NO_MEMORY, or MODAL_BAD_INPUT
 * where a number is not finite or out of the range named here (the caller checks first to name a
 * scene's path; this is the last line).  law_done frees.
 */
/* f = sum_i c[i] d^(i+1), i = 0 .. count-1; count <= LAW_TERMS_MOST.  (A cubic spring is {0, 0,
 * c}.) */
enum modal_status law_polynomial_spring(const double *c, int count, struct law *out,
                                        struct modal_error *err);
/* f = sum_i c[i] d^i v */
enum modal_status law_polynomial_damper(const double *c, int count, struct law *out,
                                        struct modal_error *err);
/* Elastic, perfectly plastic: a spring `stiffness` > 0 in series with a slider that holds up to
 * `limit` >= 0. Its memory is the slider's place z: f = stiffness (d - z), |f| <= limit; z = 0 at
 * the start. */
enum modal_status law_jenkins(double stiffness, double limit, struct law *out,
                              struct modal_error *err);
/* `count` Jenkins elements side by side; memory: their sliders' places. */
enum modal_status law_iwan(const double *stiffness, const double *limit, int count, struct law *out,
                           struct modal_error *err);
/* f = stiffness (d - clearance)(1 + dissipation v) where d > clearance, never pulling; both_sides:
 * and its mirror image below -clearance (clearance >= 0 then).  stiffness >= 0, dissipation >= 0 in
 * s/m. */
enum modal_status law_gap(double stiffness, double clearance, double dissipation, bool both_sides,
                          struct law *out, struct modal_error *err);
/* Rigid friction: f = limit sign(v); at rest whatever holds it, up to limit. */
enum modal_status law_coulomb(double limit, struct law *out, struct modal_error *err);
/* f = limit tanh(v / velocity), velocity > 0 */
enum modal_status law_regularised_coulomb(double limit, double velocity, struct law *out,
                                          struct modal_error *err);
/* Inputs: 0 normal, 1 tangential.  Normal force N = max(0, preload + normal_stiffness d_0), f_0 =
 * N; tangential a Jenkins element of tangential_stiffness whose limit is mu N of the moment.
 * Memory: the slider's place. */
enum modal_status law_contact_friction(double normal_stiffness, double preload,
                                       double tangential_stiffness, double mu, struct law *out,
                                       struct modal_error *err);
/* The friction of such a contact along another tangential, whose normal force another law gives:
 * f_0 = 0. */
enum modal_status law_contact_side(double normal_stiffness, double preload,
                                   double tangential_stiffness, double mu, struct law *out,
                                   struct modal_error *err);
/* inputs: d = (y, z) of a journal in a circular race.  SHAFT: NULL for a journal with mass, whose
 * position d is; else the stiffness (K_y, K_z) of the shaft's end at a massless journal, and d is
 * where the end would lie without contact. */
enum modal_status law_clearance(double gap, double stiffness, double dissipation,
                                const double *shaft, struct law *out, struct modal_error *err);
struct law_term { double coefficient; int on, power[LAW_INPUTS_MOST]; };
/* The sum of TERM: on input `on` coefficient prod_j d_j^power[j]; inputs <= LAW_INPUTS_MOST, a
 * term's degree at least 1. */
enum modal_status law_coupling(const struct law_term *term, int count, int inputs, struct law *out,
                               struct modal_error *err);
/* A user's `force(t, x, v, memory)` in Lua: no libraries but math, limits on instructions and
 * memory (laws/user_law.c).  A source that does not compile, or defines no function `force`, is
 * MODAL_BAD_INPUT (err->field: "source", which the caller prefixes), one that fails when called
 * MODAL_ELEMENT_FAILED; both name the line. restart empties its memory.
 *
 * The law has LAW_LUA_MOST bytes, and all that count theirs in *TOGETHER, which must outlive them,
 * LAW_LUA_TOGETHER_MOST: each of as many elements as a scene may have begins with room to spare.
 * Past either it is MODAL_ELEMENT_FAILED, which says which. */
enum modal_status law_lua(const char *source, size_t *together, struct law *out,
                          struct modal_error *err);

/* Release law->data and its ends; the struct itself is the caller's. */
void law_done(struct law *law);

/* The law at rest, with nothing remembered: while it `stays`, force i is out->f[i] + sum_j
 * out->fd[i][j] d[j].  Fails as its force does. */
enum modal_status law_rest(const struct law *law, struct law_force *out, struct modal_error *err);

/* Ends of INPUT, whose earlier inputs have theirs already; copied.  False: no memory. */
bool law_add_ends(struct law *law, int input, const struct law_end *end, int count);
/* All ends, of every input. */
int law_ends(const struct law *law);
/* What INPUT sees of the dofs' X: sum of weight x. */
double law_sees(const struct law *law, int input, const double *x);
/* GAIN of force I by displacement J between their ends, into K, n x n by columns: K += gain w_i
 * w_j^T. */
void law_spread(const struct law *law, int i, int j, double gain, int n, double *K);
/* The law's slopes where its inputs are at D, at rest and with no memory, into K and C, as
 * law_spread; *RATES where C has any of them, else as it was. */
enum modal_status law_spread_slopes(const struct law *law, const double *d, int n, double *K,
                                    double *C, bool *rates, struct modal_error *err);
/* FORCE on INPUT onto its ends: OUT[dof] += weight FORCE. */
void law_push(const struct law *law, int input, double force, double *out);

/* What constructors share: an empty law of KIND, and finiteness. */
void law_clear(struct law *law, const struct law_class *kind);
/* VALUE, called WHAT, must be finite and at least LOW; else MODAL_BAD_INPUT, field WHAT. */
enum modal_status law_check(const char *what, double value, double low, struct modal_error *err);

#endif
