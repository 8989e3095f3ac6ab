/* tracks_text.c - a form's number, what is known of all, then each track; see tracks_text.h */
#include "job/tracks_text.h"
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum {
    FORM = 2,                     /* of the text; another daemon's may be another */
    OF_ALL = 7,                   /* numbers of what is known of all tracks */
    OF_LINE = 12,                 /* of a way that has a slope */
    OF_STILL = 6,                 /* of one that has none */
    OF_EACH = 10 + OF_LINE + OF_STILL + 2 * TRACK_SHAPE,    /* numbers of one */
    BITS = 40,                    /* of what is not whole: 1,000 times finer than what tells
                                   * exponents apart */
    NUMBER_MOST = 24,             /* bytes of a number and a blank: 16 digits; or 0x, 11 digits, p,
                                   * 4 of an exponent, signs */
};
static const double COUNT_MOST = 9007199254740992.0;     /* 2^53: told apart by a double */

/* ---- numbers in their order ---- */

static void all_out(const struct tracks *t, double x[OF_ALL])
{
    x[0] = (double)t->next, x[1] = (double)t->epoch, x[2] = (double)t->first_to;
    x[3] = (double)t->to, x[4] = t->born, x[5] = t->windows, x[6] = t->count;
}

static void all_in(struct tracks *t, const double x[OF_ALL])
{
    t->next = (int64_t)x[0], t->epoch = (uint64_t)x[1], t->first_to = (uint64_t)x[2];
    t->to = (uint64_t)x[3], t->born = x[4], t->windows = x[5], t->count = (int)x[6];
    t->begun = true;
}

static void line_out(const struct track_way *w, double x[OF_LINE])
{
    x[0] = creal(w->exponent), x[1] = cimag(w->exponent);
    x[2] = w->re.value, x[3] = w->im.value, x[4] = w->freedom, x[5] = w->misfit;
    x[6] = creal(w->slope), x[7] = cimag(w->slope);
    x[8] = w->re.both, x[9] = w->re.slope, x[10] = w->im.both, x[11] = w->im.slope;
}

static struct track_way line_in(const double x[OF_LINE])
{
    return (struct track_way) { CMPLX(x[0], x[1]), CMPLX(x[6], x[7]), { x[2], x[8], x[9] },
                                { x[3], x[10], x[11] }, x[4], x[5] };
}

static void each_out(const struct track *t, double x[OF_EACH])
{
    double still[OF_LINE];

    line_out(&t->still, still);
    line_out(&t->line, x);
    memcpy(x + OF_LINE, still, OF_STILL * sizeof *x);
    x += OF_LINE + OF_STILL;
    x[0] = (double)t->number, x[1] = t->shown, x[2] = t->asked;
    x[3] = t->shape_freedom, x[4] = t->shape_misfit;
    x[5] = (double)t->since, x[6] = (double)t->last, x[7] = t->missed;
    x[8] = (t->counts ? 1 : 0) + (t->native ? 2 : 0) + (t->died ? 4 : 0);
    x[9] = t->stays;
    for (int i = 0; i < TRACK_SHAPE; i++)
        x[10 + 2 * i] = creal(t->shape[i]), x[11 + 2 * i] = cimag(t->shape[i]);
}

static void each_in(struct track *t, const double x[OF_EACH])
{
    double still[OF_LINE] = { 0 };
    struct track_way line = line_in(x);
    int flags;

    memcpy(still, x + OF_LINE, OF_STILL * sizeof *x);
    x += OF_LINE + OF_STILL;
    flags = (int)x[8];
    *t = (struct track) {
        .number = (int64_t)x[0], .line = line, .still = line_in(still), .shown = x[1],
        .asked = x[2], .shape_freedom = x[3], .shape_misfit = x[4], .since = (uint64_t)x[5],
        .last = (uint64_t)x[6], .missed = (int)x[7], .stays = x[9], .counts = (flags & 1) != 0,
        .native = (flags & 2) != 0, .died = (flags & 4) != 0 };
    for (int i = 0; i < TRACK_SHAPE; i++)
        t->shape[i] = CMPLX(x[10 + 2 * i], x[11 + 2 * i]);
}

/* ---- text ---- */

/* N behind TO. */
static char *put_decimal(char *to, uint64_t n)
{
    char digits[NUMBER_MOST];
    int count = 0;

    do
        digits[count++] = (char)('0' + n % 10);
    while ((n /= 10) > 0);
    while (count > 0)
        *to++ = digits[--count];
    return to;
}

/* N, BITS + 1 bits at most. */
static char *put_hexadecimal(char *to, uint64_t n)
{
    int shift = BITS;

    while (shift > 0 && n >> shift == 0)
        shift -= 4;
    for (; shift >= 0; shift -= 4)
        *to++ = "0123456789abcdef"[n >> shift & 15];
    return to;
}

/* Counts are whole.  The rest is hexadecimal, as %a has it: a window has hundreds of these numbers,
 * and their decimals would take as long as its modes. */
static int put(char *to, const double *x, int count)
{
    char *begin = to;

    for (int i = 0; i < count; i++) {
        int power = 0;
        double size = fabs(x[i]);
        if (x[i] < 0)
            *to++ = '-';
        if (size <= COUNT_MOST && size == (double)(uint64_t)size) {
            to = put_decimal(to, (uint64_t)size);
        } else if (!isfinite(size)) {
            memcpy(to, "nan", 3), to += 3;      /* which is refused when it is read */
        } else {
            uint64_t n = (uint64_t)llrint(ldexp(frexp(size, &power), BITS));
            *to++ = '0', *to++ = 'x';
            to = put_hexadecimal(to, n);
            power -= BITS;
            *to++ = 'p', *to++ = power < 0 ? '-' : '+';
            to = put_decimal(to, (uint64_t)abs(power));
        }
        *to++ = ' ';
    }
    return (int)(to - begin);
}

char *tracks_text_write(const struct tracks *t)
{
    char *text = malloc((size_t)(1 + OF_ALL + OF_EACH * t->count) * NUMBER_MOST + 1);
    double x[OF_EACH] = { FORM };
    int length;

    if (text == NULL)
        return NULL;
    length = put(text, x, 1);
    all_out(t, x);
    length += put(text + length, x, OF_ALL);
    for (int i = 0; i < t->count; i++) {
        each_out(&t->track[i], x);
        length += put(text + length, x, OF_EACH);
    }
    text[length - 1] = 0;
    return text;
}

/* COUNT finite numbers from *TEXT on, which moves behind them. */
static bool get(const char **text, double *x, int count)
{
    for (int i = 0; i < count; i++) {
        char *end;
        x[i] = strtod(*text, &end);
        if (end == *text || !isfinite(x[i]))
            return false;
        *text = end;
    }
    return true;
}

static bool is_count(double x, double most)
{
    return x >= 0 && x <= most && x == floor(x);
}

static bool all_good(const double x[OF_ALL])
{
    return is_count(x[0], COUNT_MOST) && is_count(x[1], COUNT_MOST)
        && is_count(x[2], COUNT_MOST) && is_count(x[3], COUNT_MOST)
        && x[4] >= 0 && x[5] >= 0 && is_count(x[6], TRACKS_MOST);
}

/* Variances; freedom and misfit. */
static bool way_good(const double x[OF_STILL])
{
    return x[2] >= 0 && x[3] >= 0 && x[4] > 0 && x[5] > 0;
}

/* As tracks_follow leaves them by the window that ends with sample TO. */
static bool each_good(const double x[OF_EACH], double next, double to)
{
    bool good = way_good(x) && x[9] >= 0 && x[11] >= 0 && way_good(x + OF_LINE);

    x += OF_LINE + OF_STILL;
    return good && is_count(x[0], next - 1) && x[1] >= 0 && x[1] <= x[2] && x[3] > 0 && x[4] > 0
        && is_count(x[6], to) && is_count(x[5], x[6]) && is_count(x[7], COUNT_MOST)
        && is_count(x[8], 7) && x[9] >= 0 && x[9] <= 1;
}

/* The tracks behind OF_ALL, all of *TEXT; false: a line is none. */
static bool lines_in(const char *text, const double of_all[OF_ALL], struct tracks *t)
{
    double x[OF_EACH];
    bool good = true;

    all_in(t, of_all);
    for (int i = 0; good && i < t->count; i++) {
        good = get(&text, x, OF_EACH) && each_good(x, of_all[0], of_all[3]);
        if (good)
            each_in(&t->track[i], x);
    }
    return good && *text == 0;
}

enum modal_status tracks_text_read(const char *text, struct tracks *t, struct modal_error *err)
{
    struct tracks *read;
    double of_all[OF_ALL], form;

    if (!get(&text, &form, 1) || form < 1 || !is_count(form, FORM) || !get(&text, of_all, OF_ALL)
        || !all_good(of_all))
        return modal_fail_field(err, MODAL_BAD_INPUT, "tracks",
                                "tracks is no line that a worker of this version wrote");
    read = calloc(1, sizeof *read);
    if (read == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "tracks: no memory");
    if (form == FORM && lines_in(text, of_all, read))
        *t = *read;
    else
        *t = (struct tracks) { .next = (int64_t)of_all[0] };
    free(read);
    return MODAL_OK;
}
