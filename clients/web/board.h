/* board.h - what is known of each stream by the events so far: its tracks, verdict, alarms, lag */
#ifndef WEB_BOARD_H
#define WEB_BOARD_H
#include <stdbool.h>
#include <stddef.h>
#include "base/json.h"

enum {
    BOARD_STREAMS = 256,         /* the one told of longest ago goes first */
    BOARD_MODES = 16,            /* of a window, the first told: those that move most */
    BOARD_ALARMS = 16,           /* that hold at once, of a stream */
    BOARD_EDGES = 32,            /* of alarms, of all streams: a screen full */
    BOARD_NAME_MOST = 128,       /* bytes of a stream's name */
    BOARD_WORD_MOST = 31,        /* of a rule, a verdict, a code */
    BOARD_TEXT_MOST = 200,       /* of an error's text: two lines of a table */
};

struct board_mode { double track, hertz, hertz_std, zeta, zeta_std; };
struct board_alarm { char rule[BOARD_WORD_MOST + 1]; double track; };

struct board_stream {
    char name[BOARD_NAME_MOST + 1], verdict[BOARD_WORD_MOST + 1];
    char error[BOARD_TEXT_MOST + 1];              /* "": the last window was identified */
    double heard;                                 /* UTC of the last event */
    double epoch, from, to;                       /* of the last window */
    double lag, skipped, gaps, missing;           /* samples, windows, gaps, samples in them */
    double mode_count;                            /* of which BOARD_MODES are here */
    int modes, alarms;
    struct board_mode mode[BOARD_MODES];
    struct board_alarm alarm[BOARD_ALARMS];
};

/* An alarm that was raised or cleared. */
struct board_edge {
    char stream[BOARD_NAME_MOST + 1], rule[BOARD_WORD_MOST + 1], state[BOARD_WORD_MOST + 1];
    double time, to, track, hertz, zeta, std;
};

struct board {
    struct board_stream *stream[BOARD_STREAMS];   /* by name */
    int streams;
    struct board_edge edge[BOARD_EDGES];          /* the newest first */
    int edges;
};

/* Take in an EVENT's header; what is of no stream changes nothing. */
void board_add(struct board *board, const cJSON *event);
/* Forget all, of whatever is there; what is of zeros is empty. */
void board_clear(struct board *board);
/* NULL: nothing was told of a stream of that name. */
const struct board_stream *board_find(const struct board *board, const char *name);
#endif
