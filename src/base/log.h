/* log.h - a line of logfmt whose texts cannot forge another member or another line */
#ifndef BASE_LOG_H
#define BASE_LOG_H
#include <stdarg.h>

/*
 * The line that printf would make of FORMAT, such as "level=warning event=exit slot=%d
 * said=\"%s\"", with each text of the arguments escaped as JSON has it where that is needed: in
 * quotes, so that it stays within them; else, where it holds a space, a quote, a backslash or a
 * control character, by being put in quotes.  Bytes that are no UTF-8 become U+FFFD. Conversions:
 * %s with a precision or without, and numbers by d, u, o, f and g, with l, ll or z; others are a
 * bug. The caller writes the line, for nothing here writes, and frees it; NULL when memory runs
 * out.
 */
char *log_text(const char *format, ...) __attribute__((format(printf, 1, 2)));
char *log_vtext(const char *format, va_list args) __attribute__((format(printf, 1, 0)));
#endif
