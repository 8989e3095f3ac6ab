/* scoring.h - the information of a spectral matrix about modes, and the step that it asks for */
#ifndef MODAL_SCORING_H
#define MODAL_SCORING_H
#include "modal/identify/ambient/whittle.h"

/* For steps, or for the errors at their end: what of the information is formed; see scoring.c. */
enum scoring_use { SCORING_STEPS, SCORING_ERRORS };

/* For models near M, by bins like BINS.  The modes of M are sorted.  *OUT is the caller's to free,
 * whatever comes.  Fails with MODAL_NO_MEMORY. */
struct scoring;
enum modal_status scoring_new(struct whittle *m, const struct bins *bins, enum scoring_use use,
                              struct scoring **out, struct modal_error *err);
void scoring_free(struct scoring *w);

/* The gradient of the logarithm of the likelihood at M; then the information there. */
void scoring_gradient(struct scoring *w, const struct whittle *m, const struct bins *bins);
void scoring_inform(struct scoring *w, const struct whittle *m, const struct bins *bins);

/* What was done so far, as long as so many entries of J take, each in each bin: some 4 ns each. */
double scoring_work(const struct scoring *w);

/*
 * The step from where the gradient was taken, M, DAMPING added to the information's diagonal in its
 * own scale; false where that has no factor.  promised: half of what it gains by the gradient;
 * settled: as many products with the information as are made were enough.
 */
struct scoring_step { double promised; bool settled; };
/* By W; *OUT tells of it. */
bool scoring_step(struct scoring *w, const struct whittle *m, const struct bins *bins,
                  double damping, struct scoring_step *out);

/* M moved by the step, its decay rates by a factor of e at most. */
void scoring_move(const struct scoring *w, const struct bins *bins, struct whittle *m);

/* The standard errors of M's exponents, from the information. */
void scoring_errors(struct scoring *w, struct whittle *m);
#endif
