/* job_options.c - see job_options.h */
#include "job/job_options.h"
#include "job/identify_options.h"
#include "job/scene_jobs.h"
#include "job/steady_settings.h"
#include "job/sweep.h"
#include "job/tradeoff_identify.h"
#include "job/tradeoff_simulate.h"
#include "job/tradeoff_steady.h"

const struct job_option_table job_option_tables[] = {
    { "identify", NULL, identify_option_rows, NULL, NULL },
    { "steady", NULL, steady_option_rows, NULL, NULL },
    { "steady", NULL, steady_curve_rows, NULL, NULL },
    { "simulate", NULL, simulate_option_rows, NULL, NULL },
    { "floquet", NULL, floquet_option_rows, NULL, NULL },
    { "tradeoff", "identify", tradeoff_identify_rows, "identify", "held on every rung" },
    { "tradeoff", "steady", tradeoff_steady_rows, NULL, NULL },
    { "tradeoff", "simulate", tradeoff_simulate_rows, NULL, NULL },
    { "sweep", NULL, sweep_option_rows, NULL, NULL },
    { "ablate", NULL, ablate_option_rows, "steady", "where the scene has harmonic excitation" },
    { "stream", NULL, NULL, "identify", "for the live windows" },
    { NULL, NULL, NULL, NULL, NULL },
};

const struct job_option_table job_document_tables[] = {
    { "sweep", "FILE.json", sweep_document_rows, NULL, NULL },
    { "sweep", "an axis of its grid", sweep_axis_rows, NULL, NULL },
    { NULL, NULL, NULL, NULL, NULL },
};
