/* trend.h - is one set of constant exponents the right model at all? */
#ifndef MODAL_TREND_H
#define MODAL_TREND_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/result.h"
#include "modal/linalg/matrix.h"

/* Of its frequency: so far a mode is taken to wander; and the least share that one shape has of a
 * crowd's energy, the square of the cosine between two shapes, where they are one mode. */
#define TREND_CLOSE 0.05
#define TREND_ONE_SHAPE 0.9

/* Of the rms: at most so much is left where decaying modes rebuild a record, or a window of it. */
#define TREND_REBUILT 0.15

enum {
    TREND_CROWD = 3,                 /* poles near one another: a pair may be two modes */
    TREND_MODES = 6,                 /* of a window, of which the strongest is watched */
    TREND_WINDOWS = 8,               /* equal parts of a record */
    TREND_WINDOWS_LONG = 28          /* a long record has room for more */
};

struct trend_input {
    const struct matrix *X;          /* the signals that were fitted, borrowed */
    double tau, t0;                  /* s: between rows; of row 0 */
    const double complex *lambda;    /* the chosen poles */
    int count;
    double hertz;                    /* what a band shifted the frequencies by */
    bool (*cancelled)(void *context);
    void *context;
    int ragged;                      /* rows that are known to be of a driven response, or of no
                                      * constant modes: windows are no longer; 0: it is not known */
    double white;                    /* where what they leave is known to be white noise: its norm
                                      * over that of the signals; else 0 */
};

/*
 * Before the modes are reported: where the chosen fit leaves more than white noise and more than
 * rounding, identify so many parts of the record on their own and compare the strongest mode of
 * each.  Adds diagnostics:
 *
 *   amplitude_dependent   frequency or damping of one mode follows its amplitude as it decays; the
 *                         message and result->trend hold the trend
 *   changes_in_record     they change otherwise: the system is not the same throughout
 *   not_free_decay        the windows neither lose energy nor are reconstructed, or their energy
 *                         rises and falls again beside a rest that is not white: driven, or noise
 *
 * *follows is true where the first was added.  Not for periodic systems.  Fails with
 * MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE, MODAL_CANCELLED.
 */
enum modal_status trend_watch(const struct trend_input *in, struct identify_result *result,
                              bool *follows, struct modal_error *err);

/* Do three or more vibrations stand about EXPONENT, a mode's, which one that drifts is made of, to
 * any accuracy? */
bool trend_crowds(const struct trend_input *in, double complex exponent);

/*
 * Do parts of the record show for themselves that the mode that decides grows?
 * Eighths, quarters and halves are identified on their own; a part says so where what its fit
 * leaves is white, and one or two of its poles grow by three of their own standard errors, one of
 * them at its frequency; two parts of a size must say so. A part that does not resolve it from a
 * stronger mode shows that one, and says nothing. An exponent that is constant and grows does so in
 * every part: what a later part shows to decay, as clearly, takes back what earlier ones said. So
 * a line whose frequency or amplitude wanders, which exponents that grow and decay make up for, is
 * no instability; one that sets in within the record is. What may be a harmonic
 * of a stronger pole does not count: it grows where that one does.  A motion set off anew within
 * the record (an impact, a load that changes) grows in the fit to the whole, and in a part at most
 * where it falls into the end of it.  *SHOWN is true, too, where the record is too short to be
 * parted.  Fails as trend_watch.
 */
enum modal_status trend_growth(const struct trend_input *in, const struct identify_result *result,
                               bool *shown, struct modal_error *err);

/* Mark the modes that are harmonics of others, before a verdict; not for periodic systems. */
void trend_mark_harmonics(struct identify_result *result);

/*
 * From the modes of RESULT alone, of a record of so many seconds; not for periodic systems:
 *
 *   harmonic_of_mode      a weak mode at twice or three times a strong one that decays as fast as
 *                         that power of it, nearer than chance would bring so many modes
 *   undamped              a mode whose amplitude is the same at both ends of the record,
 *                         to less than a hundredth
 *   mains_line            an undamped line at a multiple of 50 or 60 Hz
 *   drift                 a strong aperiodic part slower than the record beside vibrations
 */
void trend_of_modes(double record, struct identify_result *result);
#endif
