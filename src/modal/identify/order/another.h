/* another.h - does what a fit leaves hold another pole, and what would it make of the others? */
#ifndef MODAL_ANOTHER_H
#define MODAL_ANOTHER_H
#include "modal/identify/fit/refine.h"

struct another {
    struct refined fit;         /* the poles of the first, in their order, and one more, refined;
                                 * poles 0: there is none */
    double chance;              /* that noise alone lets the best pole gain so much somewhere */
};

/*
 * The pole that the rest of FIT, of DATA in white noise, shows most of is fitted beside its own.
 * The caller frees out->fit, on failure too.  Fails with MODAL_BAD_INPUT (DATA is not that of FIT),
 * MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status another_pole(const struct refine_data *data, const struct refined *fit,
                               struct another *out, struct modal_error *err);

/* Does it show enough of one for that to be asked?  Of FIT its poles and noise count alone. */
enum modal_status another_shows(const struct refine_data *data, const struct refined *fit,
                                bool *shows, struct modal_error *err);

/*
 * Pole J of FIT, converged, of a constant system's DATA, grows.  *DECAYS is true where it has a
 * neighbour within a beat over the record, and the two and one more, none of which grows, explain
 * the record as well as three that may (another.c, (3)).  Fails as another_pole.
 */
enum modal_status another_decays(const struct refine_data *data, const struct refined *fit, int j,
                                 bool *decays, struct modal_error *err);
#endif
