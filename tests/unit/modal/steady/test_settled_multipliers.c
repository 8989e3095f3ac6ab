/* The multipliers of a motion that time integration closes: as cycle.h has them, the largest first,
 * which is the one that verdicts go by. */
#include "check.h"
#include <complex.h>
#include "modal/steady/budget.h"
#include "modal/steady/cycle.h"
#include "modal/steady/settle.h"
#include "scene_text.h"

/* Two masses apart, of damping C1 and C2 over 2 pi: exp(-c pi) twice each; the spring is faint. */
static void check_two(double c1, double c2)
{
    char text[512];
    struct budget work = { .most = 1e9 };
    struct cycle_options opt = { .budget = &work };
    struct cycle found;
    struct settle *s;
    struct program *p;

    snprintf(text, sizeof text,
             "{'structure':{'type':'matrices','M':[[1,0],[0,1]],'C':[[%g,0],[0,%g]],"
             "'K':[[2,0],[0,5]]},'omega':1,'effects':[{'type':'cubic_spring','dof':'x2',"
             "'coefficient':1e-9}],'excitation':[{'dof':'x1','k':1,'cos':1},"
             "{'dof':'x2','k':1,'cos':1}]}", c1, c2);
    p = program_text(text);
    CHECK(settle_new(p, 1, &opt, &s, NULL) == MODAL_OK);
    CHECK(settle_find(s, NULL, NULL, 1e9, false, &found, NULL) == MODAL_OK);
    CHECK(settle_close(s, 1e9, &found, NULL) == MODAL_OK && found.closed);
    CHECK(settle_multipliers(s, 1e9, &found, NULL) == MODAL_OK && found.states == 4);
    for (int i = 0; i < 4; i++)
        CHECK_NEAR(cabs(found.multiplier[i]), exp(-M_PI * (i < 2 ? fmin(c1, c2) : fmax(c1, c2))),
                   1e-5);
    cycle_done(&found);
    settle_free(s);
    program_free(p);
}

TEST(the_largest_multiplier_of_a_motion_closed_in_time_comes_first_whichever_mode_has_it)
{
    check_two(0.3, 0.1);
    check_two(0.1, 0.3);
}
