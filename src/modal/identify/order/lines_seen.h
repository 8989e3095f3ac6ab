/* lines_seen.h - lines of many families: which matter to each other, which a remainder shows */
#ifndef MODAL_LINES_SEEN_H
#define MODAL_LINES_SEEN_H
#include "modal/identify/order/choose_lines.h"

/* COUNT families of exponents HEAD, Im in [0, omega/2], and all that differ from these and their
 * conjugates by multiples of i omega; L rows, tau apart. */
struct heads { const double complex *head; int count; double omega, tau; int L; };

/*
 * SHARE, per family: what of a line of it, of its energy, the nearest line of each other family on
 * either side, all together, cannot explain.  Those further off are one omega and more away.  Fails
 * with MODAL_NO_MEMORY.
 */
enum modal_status lines_shares(const struct heads *h, double *share, struct modal_error *err);

/*
 * Of ALL lines those join L, which has room for them, that are not there and whose two columns take
 * more than LEAST of chi-squared from E, what the lines of L leave, its columns of unit noise.
 * Fails with MODAL_NO_MEMORY.
 */
enum modal_status lines_seen(const struct heads *h, const struct matrix *E, double least,
                             const struct lines *all, struct lines *l, struct modal_error *err);

/*
 * *PAYS: chi-squared that a second family beside family J of L could take from E, what the fit of L
 * leaves, of unit noise, beyond LEAST of each line: those that have more are counted. Others leave
 * SHARE of a line, and E has nothing of them: beside them the same is so much more. HUGE_VAL: the
 * record does not tell.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status lines_beside(const struct matrix *E, double tau, const struct lines *l, int j,
                               double share, double least, double *pays,
                               struct modal_error *err);
#endif
