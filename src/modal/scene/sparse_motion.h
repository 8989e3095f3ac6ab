/* sparse_motion.h - the motion of many dofs at a cost that grows with them and with what happens
 *
 * Instead of stepper.h, where its dense maps and its dense matrix of all laws would cost more: long
 * explicit steps of the whole, and where laws change within one their neighbourhoods alone are
 * stepped again.
 */
#ifndef MODAL_SPARSE_MOTION_H
#define MODAL_SPARSE_MOTION_H
#include "modal/scene/simulate.h"

/* Is it the way for P, asked every dt?  Yes where only it serves, or where it is large for the
 * dense way and explicit steps, bounded by the fastest motion, are cheaper. */
bool sparse_motion_wins(const struct program *p, const struct scene_time *time);
/* Of a program that is small for the dense way: the steps of that after which this one would have
 * been cheaper; 0: it does not serve. */
int64_t sparse_motion_worth(const struct program *p, const struct scene_time *time);
/* Of a program whose modes do not decouple, so that the dense way's maps are full: how many of
 * these it may make before this way would have been cheaper; HUGE_VAL: this does not serve, or maps
 * are small. */
double sparse_motion_maps(const struct program *p, const struct scene_time *time);
/* Does it serve, several samples of TIME a leap?  Then these cost next to nothing each, where the
 * dense way takes a step. */
bool sparse_motion_strides(const struct program *p, const struct scene_time *time);

/* Is P small for the dense way, whose steps are exact in all that is linear? */
bool sparse_motion_small(const struct program *p);

/* simulate(), the same way. */
enum modal_status sparse_motion(struct program *p, const struct scene_time *time,
                                const struct simulate_options *opt, double *signals,
                                struct simulate_result *out, struct modal_error *err);
#endif
