/* nonlinear_stepper.c - stepping of nonlinear programs */
#include "modal/scene/stepper.h"
enum modal_status nonlinear_stepper_new(const struct statespace *ss, const struct sources *src, const struct stepper_options *opt,
                                        struct stepper **out, struct modal_error *err)
{
    (void)ss; (void)src; (void)opt; (void)out;
    return modal_fail_field(err, MODAL_BAD_INPUT, "effects", "nonlinear scenes are not stepped yet");
}
