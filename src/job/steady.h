/* steady.h - kind `steady`: one steady state, or a curve of them; see PROTOCOL.md for the options */
#ifndef JOB_STEADY_H
#define JOB_STEADY_H
#include "job/job.h"
#include "modal/steady/solve.h"

/*
 * Options, which override the scene's `steady`: harmonics, samples, method, cutoff, tolerance, max_iterations, stability,
 * start, solutions, dofs, located, differences, relaxation, subharmonic, time, target.error, threads; and for curves
 * sweep ("omega=A:B:N") or continue ("omega=A:B"), where any path of the scene can stand for omega; or backbone
 * ("MODE:A:B:N"): a nonlinear mode over its amplitude.
 */
enum modal_status steady_run(const struct job_request *request, struct job_result *out, struct modal_error *err);

/* What tradeoff_steady.c shares: the settings of SCENE and OPTIONS, checked, defaults written into *SHOWN (the caller's). */
struct steady_settings {
    struct steady_options opt;
    bool stability, all;
    int subharmonic, time;            /* time: samples of the waveform to print; 0: none */
    int *dofs, dofs_count;            /* reported; opt.dofs points here */
    double complex *start;            /* n x (start_H + 1) by the program's dofs, or NULL */
    int start_H;
    const char *sweep, *follow, *backbone;
};
enum modal_status steady_settings_read(const struct job_request *request, const struct program *p, struct steady_settings *out,
                                       cJSON **shown, struct modal_error *err);
void steady_settings_done(struct steady_settings *s);
/* The keys of SCENE's `steady`, whatever job the scene is for. */
enum modal_status steady_settings_keys(const cJSON *scene, struct modal_error *err);
/* The settings' start, dof by dof, as the motion of S's kept dofs; start->X is the caller's, NULL where none was given. */
enum modal_status steady_settings_start(const struct steady_settings *settings, struct steady *s, struct steady_start *start,
                                        struct modal_error *err);
/* The fundamental is omega / subharmonic: harmonics of loads and matrices move up by as much. */
void steady_subharmonic(struct program *p, int subharmonic);
#endif
