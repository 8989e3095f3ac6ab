/* board.c - see board.h */
#include "board.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "ctl/field.h"

void board_clear(struct board *board)
{
    for (int i = 0; i < board->streams; i++)
        free(board->stream[i]);
    *board = (struct board) { 0 };
}

/* Where NAME stands, or would. */
static int place_of(const struct board *board, const char *name, bool *there)
{
    int low = 0, high = board->streams;

    *there = false;
    while (low < high && !*there) {
        int middle = (low + high) / 2, order = strcmp(name, board->stream[middle]->name);
        *there = order == 0;
        low = order > 0 ? middle + 1 : *there ? middle : low;
        high = order < 0 ? middle : high;
    }
    return low;
}

const struct board_stream *board_find(const struct board *board, const char *name)
{
    bool there;
    int i = place_of(board, name, &there);

    return there ? board->stream[i] : NULL;
}

static void take_out(struct board *board, int i)
{
    free(board->stream[i]);
    memmove(board->stream + i, board->stream + i + 1,
            sizeof *board->stream * (size_t)(--board->streams - i));
}

static void drop_oldest(struct board *board)
{
    int oldest = 0;

    for (int i = 1; i < board->streams; i++)
        if (board->stream[i]->heard < board->stream[oldest]->heard)
            oldest = i;
    take_out(board, oldest);
}

/* The stream of NAME, made where it is new; NULL: no memory. */
static struct board_stream *stream_of(struct board *board, const char *name)
{
    struct board_stream *made;
    bool there;
    int i = place_of(board, name, &there);

    if (there)
        return board->stream[i];
    made = calloc(1, sizeof *made);
    if (made == NULL)
        return NULL;
    if (board->streams == BOARD_STREAMS) {
        drop_oldest(board);
        i = place_of(board, name, &there);
    }
    memmove(board->stream + i + 1, board->stream + i,
            sizeof *board->stream * (size_t)(board->streams++ - i));
    snprintf(made->name, sizeof made->name, "%s", name);
    snprintf(made->verdict, sizeof made->verdict, "-");
    made->epoch = made->to = NAN;
    return board->stream[i] = made;
}

static void take_window(struct board_stream *s, const cJSON *event)
{
    const cJSON *mode, *error = field_get(event, "error");

    if (field_real(event, "epoch") != s->epoch)
        s->alarms = 0;                   /* its alarms begin anew */
    s->epoch = field_real(event, "epoch");
    s->from = field_real(event, "from");
    s->to = field_real(event, "to");
    s->lag = field_real(field_get(event, "lag"), "samples");
    s->gaps = field_real(field_get(event, "gaps"), "count");
    s->missing = field_real(field_get(event, "gaps"), "samples");
    s->skipped = field_real(event, "skipped");
    snprintf(s->verdict, sizeof s->verdict, "%s", field_word(event, "verdict", "-"));
    snprintf(s->error, sizeof s->error, "%s", field_word(error, "message", error ? "failed" : ""));
    s->mode_count = cJSON_GetArraySize(field_get(event, "modes"));
    s->modes = 0;
    cJSON_ArrayForEach(mode, field_get(event, "modes")) {
        const cJSON *std = field_get(mode, "std");
        if (s->modes == BOARD_MODES)
            break;
        s->mode[s->modes++] = (struct board_mode) {
            field_real(mode, "track"),
            field_real(mode, "frequency_hz"), field_real(std, "frequency_hz"),
            field_real(mode, "damping_ratio"), field_real(std, "damping_ratio"),
        };
    }
}

/* Alarms of one rule differ by their track; without one NAN equals NAN. */
static bool is_same(const struct board_alarm *a, const char *rule, double track)
{
    return strcmp(a->rule, rule) == 0 && (a->track == track || (isnan(a->track) && isnan(track)));
}

static void take_alarm(struct board_stream *s, const struct board_edge *edge)
{
    int i = 0;

    while (i < s->alarms && !is_same(&s->alarm[i], edge->rule, edge->track))
        i++;
    if (strcmp(edge->state, "raised") != 0) {
        if (i < s->alarms)
            s->alarm[i] = s->alarm[--s->alarms];
    } else if (i == s->alarms && s->alarms < BOARD_ALARMS) {
        s->alarm[s->alarms].track = edge->track;
        snprintf(s->alarm[s->alarms++].rule, sizeof s->alarm->rule, "%s", edge->rule);
    }
}

static const struct board_edge *add_edge(struct board *board, const cJSON *event)
{
    const cJSON *mode = field_get(event, "mode");
    struct board_edge edge = {
        .time = field_real(event, "time"), .to = field_real(event, "to"),
        .track = field_real(mode, "track"),
        .hertz = field_real(mode, "frequency_hz"),
        .zeta = field_real(mode, "damping_ratio"),
        .std = field_real(field_get(mode, "std"), "damping_ratio"),
    };

    snprintf(edge.stream, sizeof edge.stream, "%s", field_word(event, "stream", "-"));
    snprintf(edge.rule, sizeof edge.rule, "%s", field_word(event, "rule", "-"));
    snprintf(edge.state, sizeof edge.state, "%s", field_word(event, "state", "-"));
    if (board->edges < BOARD_EDGES)
        board->edges++;
    memmove(board->edge + 1, board->edge, sizeof edge * (size_t)(board->edges - 1));
    board->edge[0] = edge;
    return &board->edge[0];
}

void board_add(struct board *board, const cJSON *event)
{
    const char *name = field_word(event, "stream", NULL), *kind = field_word(event, "event", "");
    struct board_stream *s = name != NULL ? stream_of(board, name) : NULL;

    if (s == NULL)
        return;
    s->heard = field_number(event, "time", s->heard);
    if (strcmp(kind, "modes") == 0)
        take_window(s, event);
    else if (strcmp(kind, "alarm") == 0)
        take_alarm(s, add_edge(board, event));
}
