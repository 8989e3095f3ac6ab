/* html.h - a page under way: text that is escaped, markup that is not
 *
 * The one place where what users named (keys, streams, dofs, messages) becomes part of a page.
 */
#ifndef WEB_HTML_H
#define WEB_HTML_H
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

struct html { FILE *file; char *text; size_t length; };

/* Begin a page; false: no memory. */
bool html_begin(struct html *html);
/* End it: its text is the caller's to free, a 0 behind it; NULL: memory ran out on the way. */
char *html_end(struct html *html, size_t *length);

/* Markup as it stands. */
void html_raw(struct html *html, const char *markup);
/* Any text, escaped, inside an element or a quoted attribute; control signs, which no page may
 * have, become U+FFFD. */
void html_text(struct html *html, const char *text);
/* As printf makes it, escaped. */
void html_format(struct html *html, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* A number in six digits; "-" where it is not finite. */
void html_number(struct html *html, double value);
/* An instant, in seconds since 1970 UTC: machine's and people's form; "-" where there is none. */
void html_instant(struct html *html, double utc);
/* A link to FOLDER and NAME, which is also its text. */
void html_link(struct html *html, const char *folder, const char *name);

/* EVENTS (NULL: none) is where the page's script hears what has changed, POLL the s after which it
 * looks by itself, 0: never; STREAM and TOKEN (NULL: none) are for it too. */
struct html_head { const char *title, *events, *stream, *token; int poll; };
/* The head of a page, down to its <main>. */
void html_head(struct html *html, const struct html_head *head);
/* From </main> to the end. */
void html_foot(struct html *html);

/* A part of the page that the script renews: begins as a section of that ID under TITLE. */
void html_section(struct html *html, const char *id, const char *title);
/* Its end. */
void html_section_end(struct html *html);
/* A table whose columns are named by HEADS (NULL-terminated); CAPTION is for those who hear it. */
void html_table(struct html *html, const char *caption, const char *const *heads);
/* The end of the table. */
void html_table_end(struct html *html);
#endif
