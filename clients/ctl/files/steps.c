/* steps.c - see steps.h */
#include "steps.h"
#include <ctype.h>
#include <math.h>
#include <string.h>
#include <strings.h>

const char *steps_behind_time(const char *name)
{
    static const char *const words[] = { "time", "zeit", "temps", "tiempo", "t" };

    for (size_t i = 0; name != NULL && i < sizeof words / sizeof *words; i++) {
        size_t n = strlen(words[i]);
        if (strncasecmp(name, words[i], n) == 0 && !isalnum((unsigned char)name[n]))
            return name + n;
    }
    return NULL;
}

/* The one of WORDS, the last of which is NULL, that stands first in TEXT, bare or in brackets; but
 * for its case where none is written so: mHz is no MHz. */
static const char *word_of(const char *text, const char *const words[])
{
    const char *at = text != NULL ? text + strspn(text, " _-.,:/[(<") : "";
    size_t length = strcspn(at, " _-.,:/])>"), i = 0;

    while (words[i] != NULL && (strlen(words[i]) != length || strncmp(at, words[i], length) != 0))
        i++;
    if (words[i] != NULL)
        return words[i];
    for (i = 0; words[i] != NULL; i++)
        if (strlen(words[i]) == length && strncasecmp(at, words[i], length) == 0)
            break;
    return words[i];
}

const char *steps_unit(const char *text)
{
    static const char *const seconds[] = { "s", "sec", "secs", "second", "seconds", NULL };
    static const char *const others[] = {
        "ms", "msec", "msecs", "millisecond", "milliseconds", "us", "usec", "usecs", "\xc2\xb5s",
        "\xce\xbcs", "microsecond", "microseconds", "ns", "nsec", "nsecs", "nanosecond",
        "nanoseconds", "min", "mins", "minute", "minutes", "h", "hr", "hrs", "hour", "hours", "d",
        "day", "days", NULL,
    };
    const char *other = word_of(text, others);

    return word_of(text, seconds) != NULL ? seconds[0] : other != NULL ? other : "";
}

const char *steps_rate_unit(const char *text)
{
    static const char *const rates[] = { "Hz", "kHz", "MHz", "mHz", "GHz", NULL };
    const char *rate = word_of(text, rates);

    return rate != NULL ? rate : "";
}

enum modal_status steps_unit_check(const char *unit, const char *path, const char *what,
                                   const struct signals_options *options, struct modal_error *err)
{
    if (unit[0] == 0 || strcmp(unit, "s") == 0 || options->ignore_time)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, "time", "%s: %s says its times in %s; accepted: "
                            "in s, or --dt SECONDS with --ignore-time; what is no time needs "
                            "another name", path, what, unit);
}

size_t steps_turn_back(const double *t, size_t n, size_t stride)
{
    for (size_t k = 1; k < n; k++)
        if (!(t[k * stride] > t[(k - 1) * stride]))
            return k;
    return 0;
}

double steps_deviation(const double *t, size_t n, size_t stride, double *dt)
{
    double most = 0;

    *dt = n < 2 ? 0 : (t[(n - 1) * stride] - t[0]) / (double)(n - 1);
    for (size_t k = 0; k < n && *dt > 0; k++) {
        double off = fabs(t[k * stride] - t[0] - (double)k * *dt) / *dt;
        if (!(off <= most))
            most = off;
    }
    return *dt > 0 ? most : HUGE_VAL;
}

enum modal_status steps_refuse(const double *t, size_t n, size_t stride, double off,
                               const char *path, const char *what,
                               const struct signals_options *options, struct modal_error *err)
{
    const char *field = options->dt > 0 ? "dt" : "time";
    const char *way = options->dt > 0 ? "--ignore-time takes the rows as even"
                                      : "or --dt SECONDS with --ignore-time";
    size_t back = steps_turn_back(t, n, stride);

    if (back > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: %s is time, but it does "
                                "not grow at sample %zu; accepted: even steps forward; %s",
                                path, what, back, way);
    return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: %s is time, but its steps "
                            "are uneven: a sample is %.3g steps from its place, "
                            "accepted: %g; resample; %s", path, what, off, STEPS_UNEVEN_MOST, way);
}

enum modal_status steps_read(const double *t, size_t n, double digits, const char *path,
                             const char *what, const struct signals_options *options,
                             struct signals *out, struct modal_error *err)
{
    double dt, off = steps_deviation(t, n, 1, &dt), last;

    if (options->ignore_time)
        return MODAL_OK;
    if (!(off <= STEPS_UNEVEN_MOST))
        return steps_refuse(t, n, 1, off, path, what, options, err);
    last = fmax(fabs(t[0]), fabs(t[n - 1]));
    out->dt = dt;
    out->dt_off = fmax(digits * last / (double)(n - 1), SIGNALS_DT_OFF * dt);
    out->dt_from = "its times";
    return MODAL_OK;
}
