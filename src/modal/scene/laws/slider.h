/* slider.h - the numbers of laws with sliders, for the files of laws/ */
#ifndef MODAL_LAWS_SLIDER_H
#define MODAL_LAWS_SLIDER_H

struct sliders {
    int count;
    struct slider { double stiffness, limit; } element[];   /* N/m, N */
};

struct contact {
    double normal_stiffness, preload, tangential_stiffness, mu;   /* N/m, N, N/m, 1 */
};
#endif
