/* condense_state.h - what the files of condense.h share */
#ifndef MODAL_CONDENSE_STATE_H
#define MODAL_CONDENSE_STATE_H
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"
#include "modal/steady/condense.h"

/* The program's linear part, where each dof is in it, and what the last condense_at left. */
struct condense {
    const struct program *p;
    int n, q, r, order;              /* dofs, kept, linear; order = r + n_linear */
    struct pattern *pattern;         /* of S */
    int *entry;                      /* in it, of M's, C's and K's entries; NULL: not looked up */
    int *place, *kept, *spot;        /* spot[dof]: row among the linear ones, or -1 */
    int lower, upper, ld;            /* band of L_rr; ld = 2 lower + upper + 1 */
    double complex *band, *right;    /* right: order x (q+1) */
    double *size;                    /* of each column, before factoring */
    double *terms;                   /* q + 1: sizes of what is taken from a row of S_0 and p_0 */
    int *pivot;                      /* of the band */
    int highest;                     /* harmonic of the loads */
    /* harmonics on the program's axes */
    struct condense_load { int dof, k; double complex value; } *load;
    int loads;                       /* of `load`: up to four of one of the program's */
    /* of the last condense_at */
    double omega, level;             /* rad/s; what loads are multiplied by */
    int H;                           /* harmonics 0 .. H are there */
    double complex *kept_right;      /* (H+1) x order x (q+1): L_rr^-1 [L_rq, P_r]; NULL: not
                                      * kept */
    size_t kept_size;
    struct workspace space;          /* of the other arrays */
    /* sparse: no band; harmonics 0 .. known - 1 of `known_at` are kept, for loads of level 1 */
    bool sparse;
    struct pattern *linear;          /* of L_rr; NULL: none was factored */
    struct sparse_lu *factors;
    double complex *value, *column;  /* of `linear`; order, of a solution */
    int *seat, seats;                /* of each dof among those recovered, or -1 */
    /* row: seats x (q+1); stale: to be learnt anew */
    struct condense_harmonic {
        double complex *S, *p, *row;
        double doubt;                /* relative, of what a basis made; 0: factored */
        bool stale;
        bool rough;                  /* made for an estimate, and for no more */
    } *harmonic;
    int known, harmonics;            /* harmonics: places */
    /* of condense_rough, for harmonics past `exact`: forces, of 0 .. top a dof; NULL: all are asked
     * for; and the largest that they were seen to move */
    const double complex *force;
    int exact, top;
    double moved, left;              /* left: what those left out may move */
    double known_at, work;           /* rad/s; operations of budget.h so far */
    struct condense_lanczos *lanczos;   /* condense_lanczos.c, else, where not NULL, */
    struct condense_basis *basis;    /* condense_basis.c; both NULL: each harmonic is factored */
    /* modes */
    bool reduced, massless;          /* massless: M_rq = 0, one sum a pair */
    bool solved;                     /* kept_right is that of the last condense_at */
    double beta;                     /* C = alpha M + beta K */
    double *phi;                     /* r x r */
    double *lambda, *damping;
    double *ak, *am;                 /* phi^T K_rq, M_rq: r x q */
    double *weight;                  /* [i][j][4][r]: see weights() */
    double complex *rest;            /* S_0 and p_0 of level 1, q x (q + 1), by factoring, */
    bool rested;                     /* once that did not fail */
};

/* What a matrix of type T (PROGRAM_M, _C, _K) is multiplied by at s = k omega, (1) of
 * condense.h. */
static inline double complex factor_of(int t, double s)
{
    return t == PROGRAM_M ? -s * s : t == PROGRAM_C ? I * s : 1;
}

/* Each entry of A_rq of matrix T: (row among the linear, column among the kept). */
#define EACH_COUPLING(c, a, i, e) \
    for (int i = 0; i < (a)->m; i++) \
        for (int e = (c)->spot[i] >= 0 ? (a)->start[i] : (a)->start[i + 1]; \
             e < (a)->start[i + 1]; e++) \
            if ((c)->place[(a)->index[e]] >= 0)

/* S_k and p_k of (2) by factoring, s = k omega; what recovery needs is kept. */
enum modal_status condense_factor_at(struct condense *c, int k, double s, double complex *S,
                                     double complex *p, struct modal_error *err);
/* The solutions that recovery needs, which a reduced condense_at did not make. */
enum modal_status condense_solve_for_recovery(struct condense *c, struct modal_error *err);

/* What is kept of the last omega goes, but harmonics below KEEP. */
void condense_forget(struct condense *c, int keep);
/* Is harmonic K asked for, and not known so well? */
bool condense_lacks(const struct condense *c, int k);
/* Room for one more harmonic, which is stale.  Fails with MODAL_NO_MEMORY. */
enum modal_status condense_add_harmonic(struct condense *c, struct modal_error *err);

/* S and p, both 0 before, of harmonics 1 .. H by (3) of condense_modes.c, once condense_reduce
 * is done. */
void condense_reduced_at(struct condense *c, int H, double complex *S, double complex *p);
/* Lambda at s onto S where every dof is kept and the pattern is not full; else false. */
bool condense_whole(struct condense *c, double s, double complex *S);
/* L_qq at s onto S, q x q. */
void condense_kept_block(struct condense *c, double s, double complex *S);

/* Whether C = alpha M + beta K entry by entry, on the whole structure. */
bool condense_proportional(const struct condense *c, double *alpha, double *beta);

/* Harmonic K by one real factorization into H, after more steps where it takes them; ROUGH: as
 * condense_rough has it; false: it does not serve there, and H is to be made anew.  Where that
 * factorization is none at all there is a basis from now on. */
bool condense_lanczos_answer(struct condense *c, int k, bool rough, struct condense_harmonic *h);
/* That many harmonics of this frequency will be asked for, beside those of an estimate: those of
 * the first one are known before one is, and with the points what may be ventured on it. */
void condense_lanczos_expect(struct condense *c, int harmonics);
/* Whether harmonic K, of an estimate, moves so little that it is left out; then c->left has it. */
bool condense_lanczos_leaves(struct condense *c, int k);
/* A harmonic had to be factored, ROUGH: for an estimate; it may give itself up. */
void condense_lanczos_missed(struct condense *c, bool rough);
void condense_lanczos_free(struct condense *c);     /* of none, too */

/* A basis, empty, of that tolerance.  Fails with MODAL_NO_MEMORY. */
enum modal_status condense_basis_new(struct condense *c, double tolerance,
                                     struct modal_error *err);
/* Harmonic K by the basis into H; ROUGH: as condense_rough has it; false: it does not serve there,
 * and H is to be made anew. */
bool condense_basis_answer(struct condense *c, int k, bool rough, struct condense_harmonic *h);
/* The solutions in c->right, which is lost, and those of the dofs wanted join the basis, which may
 * give itself up. */
void condense_basis_join(struct condense *c);
void condense_basis_free(struct condense *c);       /* of none, too */
/* (2) of condense_basis.c but for |L^ ^-1|, relative: of S of H, harmonic K, to its largest, of p
 * to the loads, of rows wanted to the motion of a kept dof that is 1 and to what the loads move.
 * SIZE: of what is left of each kept dof's column, of each wanted one's, and at LAST of the
 * loads'. */
double condense_harmonic_doubt(const struct condense *c, int k, const struct condense_harmonic *h,
                               const double *size, int last);
#endif
