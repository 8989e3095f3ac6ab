/* tracks_text.c - a form's number, what is known of all, then each track; see tracks_text.h */
#include "job/tracks_text.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum {
    FORM = 1,                     /* of the text; another daemon's may be another */
    OF_ALL = 7,                   /* numbers of what is known of all tracks */
    OF_EACH = 22 + 2 * TRACK_SHAPE,    /* numbers of one */
    NUMBER_MOST = 24,             /* bytes of a number and a blank */
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

static void each_out(const struct track *t, double x[OF_EACH])
{
    x[0] = (double)t->number, x[1] = creal(t->exponent), x[2] = cimag(t->exponent);
    x[3] = creal(t->slope), x[4] = cimag(t->slope);
    x[5] = t->re.value, x[6] = t->re.both, x[7] = t->re.slope;
    x[8] = t->im.value, x[9] = t->im.both, x[10] = t->im.slope;
    x[11] = t->freedom, x[12] = t->misfit, x[13] = t->shown, x[14] = t->asked;
    x[15] = t->shape_freedom, x[16] = t->shape_misfit;
    x[17] = (double)t->since, x[18] = (double)t->last, x[19] = t->missed;
    x[20] = (t->counts ? 1 : 0) + (t->native ? 2 : 0) + (t->died ? 4 : 0);
    x[21] = t->stays;
    for (int i = 0; i < TRACK_SHAPE; i++)
        x[22 + 2 * i] = creal(t->shape[i]), x[23 + 2 * i] = cimag(t->shape[i]);
}

static void each_in(struct track *t, const double x[OF_EACH])
{
    int flags = (int)x[20];

    *t = (struct track) {
        .number = (int64_t)x[0], .exponent = CMPLX(x[1], x[2]), .slope = CMPLX(x[3], x[4]),
        .re = { x[5], x[6], x[7] }, .im = { x[8], x[9], x[10] }, .freedom = x[11],
        .misfit = x[12], .shown = x[13], .asked = x[14], .shape_freedom = x[15],
        .shape_misfit = x[16], .since = (uint64_t)x[17], .last = (uint64_t)x[18],
        .missed = (int)x[19], .stays = x[21], .counts = (flags & 1) != 0,
        .native = (flags & 2) != 0, .died = (flags & 4) != 0 };
    for (int i = 0; i < TRACK_SHAPE; i++)
        t->shape[i] = CMPLX(x[22 + 2 * i], x[23 + 2 * i]);
}

/* ---- text ---- */

/* Counts are whole; 12 digits of the rest are 1,000 times finer than what tells exponents apart. */
static int put(char *to, const double *x, int count)
{
    int length = 0;

    for (int i = 0; i < count; i++)
        length += sprintf(to + length, x[i] == floor(x[i]) && fabs(x[i]) <= COUNT_MOST
                                           ? "%.0f " : "%.12g ", x[i]);
    return length;
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

/* As tracks_follow leaves them by the window that ends with sample TO. */
static bool each_good(const double x[OF_EACH], double next, double to)
{
    bool positive = x[2] >= 0 && x[5] >= 0 && x[7] >= 0 && x[8] >= 0 && x[10] >= 0;

    for (int i = 11; i <= 16; i++)
        positive &= i == 13 || i == 14 ? x[i] >= 0 : x[i] > 0;
    return positive && is_count(x[0], next - 1) && x[13] <= x[14] && is_count(x[18], to)
        && is_count(x[17], x[18]) && is_count(x[19], COUNT_MOST) && is_count(x[20], 7)
        && x[21] >= 0 && x[21] <= 1;
}

enum modal_status tracks_text_read(const char *text, struct tracks *t, struct modal_error *err)
{
    struct tracks *read = calloc(1, sizeof *read);
    double of_all[OF_ALL] = { 0 }, x[OF_EACH] = { 0 };
    bool good = read != NULL && get(&text, x, 1) && x[0] == FORM && get(&text, of_all, OF_ALL)
        && all_good(of_all);

    if (good)
        all_in(read, of_all);
    for (int i = 0; good && i < read->count; i++) {
        good = get(&text, x, OF_EACH) && each_good(x, of_all[0], of_all[3]);
        if (good)
            each_in(&read->track[i], x);
    }
    good = good && *text == 0;
    if (good)
        *t = *read;
    if (!good && read == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "tracks: no memory");
    free(read);
    return good ? MODAL_OK
                : modal_fail_field(err, MODAL_BAD_INPUT, "tracks",
                                   "tracks is no line that a worker of this version wrote");
}
