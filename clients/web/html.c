/* html.c - see html.h */
#include "html.h"
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "base/utf8.h"
#include "url.h"

bool html_begin(struct html *html)
{
    *html = (struct html) { 0 };
    html->file = open_memstream(&html->text, &html->length);
    return html->file != NULL;
}

char *html_end(struct html *html, size_t *length)
{
    bool bad = ferror(html->file);

    bad |= fclose(html->file) != 0;
    if (bad) {
        free(html->text);
        html->text = NULL;
    }
    *length = html->length;
    return html->text;
}

void html_raw(struct html *html, const char *markup)
{
    fputs(markup, html->file);
}

void html_text(struct html *html, const char *text)
{
    int control;

    for (; *text != 0; text++)
        switch (*text) {
        case '<': fputs("&lt;", html->file); break;
        case '>': fputs("&gt;", html->file); break;
        case '&': fputs("&amp;", html->file); break;
        case '"': fputs("&quot;", html->file); break;
        case '\'': fputs("&#39;", html->file); break;
        case '\n': case '\t': fputc(*text, html->file); break;
        default:
            control = utf8_control_length(text);
            if (control == 0)
                fputc(*text, html->file);
            else
                fputs("\xef\xbf\xbd", html->file);
            text += control > 0 ? control - 1 : 0;
        }
}

void html_format(struct html *html, const char *format, ...)
{
    char *text = NULL;
    va_list args;

    va_start(args, format);
    if (vasprintf(&text, format, args) >= 0) {
        html_text(html, text);
        free(text);
    }
    va_end(args);
}

void html_number(struct html *html, double value)
{
    if (isfinite(value))
        fprintf(html->file, "%.6g", value);
    else
        fputs("-", html->file);
}

void html_instant(struct html *html, double utc)
{
    static const double year_9999 = 253402300799.0;      /* its last second: four digits */
    struct tm parts;
    char machine[32], people[32];

    if (!(utc > 0) || utc > year_9999 || gmtime_r(&(time_t) { (time_t)utc }, &parts) == NULL) {
        fputs("-", html->file);
        return;
    }
    strftime(machine, sizeof machine, "%Y-%m-%dT%H:%M:%SZ", &parts);
    strftime(people, sizeof people, "%Y-%m-%d %H:%M:%S", &parts);
    fprintf(html->file, "<time datetime=\"%s\">%s</time>", machine, people);
}

void html_link(struct html *html, const char *folder, const char *name)
{
    char path[3 * URL_NAME_MOST + 1];

    url_escape(name, path);
    fprintf(html->file, "<a href=\"%s%s\">", folder, path);
    html_text(html, name);
    fputs("</a>", html->file);
}

static void attribute(struct html *html, const char *name, const char *value)
{
    if (value == NULL)
        return;
    fprintf(html->file, " %s=\"", name);
    html_text(html, value);
    fputc('"', html->file);
}

void html_head(struct html *html, const struct html_head *head)
{
    html_raw(html, "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
                   "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
                   "<meta name=\"color-scheme\" content=\"light dark\">\n<title>");
    html_text(html, head->title);
    html_raw(html, " - modald</title>\n<link rel=\"icon\" href=\"/icon.svg\">\n"
                   "<link rel=\"stylesheet\" href=\"/uPlot.min.css\">\n"
                   "<link rel=\"stylesheet\" href=\"/page.css\">\n"
                   "<script defer src=\"/uPlot.iife.min.js\"></script>\n"
                   "<script defer src=\"/page.js\"></script>\n</head>\n<body");
    attribute(html, "data-events", head->events);
    attribute(html, "data-stream", head->stream);
    attribute(html, "data-token", head->token);
    fprintf(html->file, " data-poll=\"%d\">\n", head->poll);
    html_raw(html, "<a class=\"skip\" href=\"#main\">to the content</a>\n"
                   "<header><nav><a href=\"/\">modald</a></nav>"
                   "<p id=\"live\" role=\"status\"></p></header>\n"
                   "<main id=\"main\" tabindex=\"-1\">\n<h1>");
    html_text(html, head->title);
    html_raw(html, "</h1>\n");
}

void html_foot(struct html *html)
{
    html_raw(html, "</main>\n<noscript><p>Without its script this page shows what was so when it "
                   "was loaded.</p></noscript>\n</body>\n</html>\n");
}

void html_section(struct html *html, const char *id, const char *title)
{
    fprintf(html->file, "<section id=\"%s\" data-live aria-labelledby=\"%s-title\">\n"
            "<h2 id=\"%s-title\">%s</h2>\n", id, id, id, title);
}

void html_section_end(struct html *html)
{
    html_raw(html, "</section>\n");
}

void html_table(struct html *html, const char *caption, const char *const *heads)
{
    html_raw(html, "<div class=\"wide\" tabindex=\"0\" role=\"region\"");
    attribute(html, "aria-label", caption);
    html_raw(html, "><table>\n<caption>");
    html_text(html, caption);
    html_raw(html, "</caption>\n<thead><tr>");
    for (; *heads != NULL; heads++) {
        html_raw(html, "<th scope=\"col\">");
        html_text(html, *heads);
        html_raw(html, "</th>");
    }
    html_raw(html, "</tr></thead>\n<tbody>\n");
}

void html_table_end(struct html *html)
{
    html_raw(html, "</tbody></table></div>\n");
}
