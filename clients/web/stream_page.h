/* stream_page.h - one stream: frequency and damping of each track over time, verdict, alarms */
#ifndef WEB_STREAM_PAGE_H
#define WEB_STREAM_PAGE_H
#include "board.h"
#include "html.h"

struct visit;

/* Answer VISIT by the page of its stream. */
void stream_page_show(struct visit *visit);

/* The stream's verdict, and its error where the last window was not identified. */
void stream_page_verdict(struct html *html, const struct board_stream *s);
/* The alarms that hold, in words. */
void stream_page_alarms(struct html *html, const struct board_stream *s);
/* The last edges of alarms: of STREAM, "" of all. */
void stream_page_edges(struct html *html, const struct board *board, const char *stream);
#endif
