/* identify_ladder.h - the ladder of identify's settings, cheap and rough to dear and exact, and the
 * error of an answer */
#ifndef JOB_IDENTIFY_LADDER_H
#define JOB_IDENTIFY_LADDER_H
#include "job/identify_options.h"
#include "job/job.h"
#include "modal/ladder.h"

/* Room for the table of rungs (14) and some more. */
enum { IDENTIFY_RUNGS_MOST = 24 };

/* What the rungs are made for.  `order` 0: unknown, and no rung fixes it. */
struct identify_ladder_facts {
    enum identify_response response;
    size_t samples, channels;
    double dt, period;           /* s; period 0: none */
    int order;                   /* columns of the basis: 2 for each pair */
    double highest_hz;           /* of the modes; 0: unknown */
    double window[2];            /* s, of the record used */
};

/*
 * Options of each rung: ASKED (an object, or NULL) with the rung's own keys laid over it, so that
 * they can be pasted back.  SHORT_ONE: the default procedure on a quarter, half and all of the
 * record, which an ordinary identify climbs; else all that the facts allow.  Returns the count; the
 * caller deletes each.
 */
int identify_ladder_rungs(const cJSON *asked, const struct identify_ladder_facts *facts,
                          bool short_one, cJSON *settings[IDENTIFY_RUNGS_MOST]);

/* The answer's own estimate: the largest standard error (or error bar) of an exponent over its
 * modulus; NAN: no mode, or unknown. */
double identify_error(const struct identify_result *result);

/* The largest |lambda - truth| / |truth| over COUNT true exponents, each matched to a mode of
 * its own, nearest pairs first; one without a mode counts as 1 and adds to *unmatched. */
double identify_distance(const struct identify_result *result, const double complex *truth,
                         int count, int *unmatched);

/*
 * modal_identify of REQUEST's batch as SETTINGS say, asking REQUEST whether to stop, on the
 * processor's clock; its answer in *OUT (identify_result_done).  Fails as modal_identify does.
 */
enum modal_status identify_answer(const struct job_request *request,
                                  const struct identify_settings *settings,
                                  struct identify_result *out, struct modal_error *err);

/* The same of a rung's options; fails as identify_options_read does, too. */
enum modal_status identify_ladder_answer(const struct job_request *request, const cJSON *rung,
                                         struct identify_result *out, struct modal_error *err);
#endif
