/* event_show.c - see event_show.h */
#include <math.h>
#include <stdio.h>
#include "event_show.h"
#include "field.h"
#include "live_modes.h"
#include "outcome.h"

static void show_alarm(const cJSON *event)
{
    const cJSON *mode = cJSON_GetObjectItemCaseSensitive(event, "mode"),
                *std = cJSON_GetObjectItemCaseSensitive(mode, "std");

    if (cJSON_HasObjectItem(event, "rule"))
        printf(" %s", field_word(event, "rule", "-"));
    if (mode != NULL && cJSON_HasObjectItem(mode, "track"))
        printf("  [%.0f]", field_real(mode, "track"));
    if (mode != NULL)
        printf("  %.6g Hz  zeta %.5g +- %.1e", field_real(mode, "frequency_hz"),
               field_real(mode, "damping_ratio"), field_real(std, "damping_ratio"));
}

static void show_track(const cJSON *event)
{
    if (cJSON_HasObjectItem(event, "track"))
        printf("  [%.0f]  %.6g Hz  zeta %.5g", field_real(event, "track"),
               field_real(event, "frequency_hz"),
               field_real(event, "damping_ratio"));
}

static void show_line(const cJSON *event)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(event, "error");

    printf("%8.0f  %-8s %-20s", field_real(event, "number"), field_word(event, "event", "-"),
           field_word(event, "stream", field_word(event, "job", "-")));
    if (cJSON_HasObjectItem(event, "state"))
        printf(" %s", field_word(event, "state", "-"));
    live_modes_show(event);
    show_alarm(event);
    show_track(event);
    if (error != NULL)
        printf("  %s: %s", field_word(error, "code", "-"), field_word(error, "message", "-"));
    putchar('\n');
    fflush(stdout);
}

enum modal_status event_show(cJSON *event, bool json, struct modal_error *err)
{
    cJSON_DeleteItemFromObjectCaseSensitive(event, "subscription");
    if (json)
        return outcome_json(event, err);
    show_line(event);
    return MODAL_OK;
}
