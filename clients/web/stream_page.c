/* stream_page.c - see stream_page.h */
#include "stream_page.h"
#include <math.h>
#include <string.h>
#include "site.h"

void stream_page_verdict(struct html *html, const struct board_stream *s)
{
    html_raw(html, "<span class=\"");
    html_text(html, s->verdict);
    html_raw(html, "\">");
    html_text(html, s->verdict);
    html_raw(html, "</span>");
    if (s->error[0] != 0)
        html_format(html, " (%s)", s->error);
}

void stream_page_alarms(struct html *html, const struct board_stream *s)
{
    for (int i = 0; i < s->alarms; i++) {
        html_text(html, i > 0 ? ", " : "");
        html_text(html, s->alarm[i].rule);
        if (isfinite(s->alarm[i].track))
            html_format(html, " [%.0f]", s->alarm[i].track);
    }
}

void stream_page_edges(struct html *html, const struct board *board, const char *stream)
{
    static const char *const heads[] = { "when, UTC", "stream", "rule", "state", "track", "Hz",
                                         "damping ratio", "\xc2\xb1", "sample", NULL };

    html_table(html, "The last alarms", heads);
    for (int i = 0; i < board->edges; i++) {
        const struct board_edge *e = &board->edge[i];
        const double numbers[] = { e->track, e->hertz, e->zeta, e->std, e->to };
        if (stream[0] != 0 && strcmp(stream, e->stream) != 0)
            continue;
        html_raw(html, strcmp(e->state, "raised") == 0 ? "<tr class=\"alarm\"><td>" : "<tr><td>");
        html_instant(html, e->time);
        html_raw(html, "</td><th scope=\"row\">");
        html_link(html, "/streams/", e->stream);
        html_raw(html, "</th><td>");
        html_text(html, e->rule);
        html_raw(html, "</td><td>");
        html_text(html, e->state);
        for (size_t k = 0; k < sizeof numbers / sizeof numbers[0]; k++) {
            html_raw(html, "</td><td>");
            html_number(html, numbers[k]);
        }
        html_raw(html, "</td></tr>\n");
    }
    html_table_end(html);
}

static void show_now(struct html *html, const struct board_stream *s)
{
    static const char *const heads[] = { "track", "frequency, Hz", "\xc2\xb1", "damping ratio",
                                         "\xc2\xb1", NULL };

    html_section(html, "now", "Now");
    html_raw(html, "<p>");
    stream_page_verdict(html, s);
    html_format(html, "; epoch %.0f, samples %.0f to %.0f; lag %.0f samples, %.0f windows skipped, "
                "%.0f gaps (%.0f samples); heard ", s->epoch, s->from, s->to, s->lag, s->skipped,
                s->gaps, s->missing);
    html_instant(html, s->heard);
    html_raw(html, "</p>\n");
    html_table(html, "Modes of the last window", heads);
    for (int i = 0; i < s->modes; i++) {
        const struct board_mode *m = &s->mode[i];
        const double numbers[] = { m->hertz, m->hertz_std, m->zeta, m->zeta_std };
        html_raw(html, "<tr><th scope=\"row\">");
        html_number(html, m->track);
        html_raw(html, "</th>");
        for (size_t k = 0; k < sizeof numbers / sizeof numbers[0]; k++) {
            html_raw(html, "<td>");
            html_number(html, numbers[k]);
            html_raw(html, "</td>");
        }
        html_raw(html, "</tr>\n");
    }
    html_table_end(html);
    if (s->mode_count > s->modes)
        html_format(html, "and %.0f more", s->mode_count - s->modes);
    html_section_end(html);
}

void stream_page_show(struct visit *visit)
{
    const struct board *board = &visit->site->service.board;
    const struct board_stream *s = board_find(board, visit->url.name);
    char events[3 * URL_NAME_MOST + 64], name[3 * URL_NAME_MOST + 1];
    struct html html;

    if (!visit->site->service.here) {
        visit_fail_by(visit, NULL);
        return;
    }
    if (!html_begin(&html)) {
        visit_end(visit, MHD_HTTP_INTERNAL_SERVER_ERROR, "text/plain", NULL, 0);
        return;
    }
    url_escape(visit->url.name, name);
    snprintf(events, sizeof events, "/events?from=%lld&stream=%s",
             (long long)feed_first(visit->site->service.feed), name);
    html_head(&html, &(struct html_head) { .title = visit->url.name, .stream = visit->url.name,
                                           .events = events, .poll = s == NULL ? 2 : 0 });
    if (s == NULL)
        html_raw(&html, "<p>No window of a stream of this name was told of late; this page waits "
                        "for one.</p>\n");
    else {
        html_raw(&html, "<div id=\"frequency\" class=\"plot\"></div>\n"
                        "<div id=\"damping\" class=\"plot\"></div>\n");
        show_now(&html, s);
        html_section(&html, "alarms", "Alarms");
        stream_page_edges(&html, board, visit->url.name);
        html_section_end(&html);
    }
    html_foot(&html);
    visit_end_page(visit, s == NULL ? MHD_HTTP_NOT_FOUND : MHD_HTTP_OK, &html);
}
