/* gap.h - the numbers of a gap, for the files of laws/ */
#ifndef MODAL_LAWS_GAP_H
#define MODAL_LAWS_GAP_H
#include <stdbool.h>

struct gap {
    double stiffness, clearance, dissipation;   /* N/m, m, s/m */
    bool both_sides;
};
#endif
