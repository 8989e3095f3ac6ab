/* steady_settings.h - what a steady state is to be solved for: options of the job over the scene's
 * `steady` */
#ifndef JOB_STEADY_SETTINGS_H
#define JOB_STEADY_SETTINGS_H
#include "base/key_table.h"
#include "job/job.h"
#include "modal/scene/program.h"
#include "modal/steady/point.h"

struct program;

/* What the scene's `steady` may hold, and the options too; what the options alone may, of which one
 * at most. */
extern const struct key_row steady_option_rows[], steady_curve_rows[];

struct steady_settings {
    struct steady_options opt;
    bool stability, located;
    int solutions;                    /* 1: all of them */
    int threads, subharmonic;
    int time;                         /* samples of the waveform to print; 0: none; -1: as many as
                                         were solved with */
    int *dofs, dofs_count;            /* reported; opt.dofs points here */
    int *keep, keep_count;            /* opt.keep */
    double complex *start;            /* n x (start_H + 1) by the program's dofs, or NULL */
    int start_H;
    double tones[PROGRAM_TONES_MOST];     /* rad/s, of several without a common period */
    int tones_count;                  /* 0: one, omega */
    int free_tone;                    /* 1 + which of them is the motion's own; 0: none */
    const char *sweep, *follow, *backbone;      /* the request's own */
};

/*
 * Those of REQUEST on its scene, lowered as P.  *SHOWN: options with their defaults, as they can be
 * pasted back, the caller's.  steady_settings_done frees what *OUT holds.  MODAL_BAD_INPUT, field
 * an option or `steady.KEY`; *OUT and *SHOWN are empty then.
 */
enum modal_status steady_settings_read(const struct job_request *request, const struct program *p,
                                       struct steady_settings *out, cJSON **shown,
                                       struct modal_error *err);
void steady_settings_done(struct steady_settings *s);

/* The keys of SCENE's `steady` alone, whatever job the scene is for; MODAL_BAD_INPUT names one that
 * is unknown. */
enum modal_status steady_settings_keys(const cJSON *scene, struct modal_error *err);

/* The settings' start, dof by dof, as the motion of S's kept dofs; start->X is the caller's, NULL
 * where none was given. */
enum modal_status steady_settings_start(const struct steady_settings *settings, struct steady *s,
                                        struct steady_start *start, struct modal_error *err);

/* The fundamental is omega / subharmonic: harmonics of loads and matrices move up by as much. */
void steady_subharmonic(struct program *p, int subharmonic);
#endif
