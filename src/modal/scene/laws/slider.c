/*
 * slider.c - friction with a spring: Jenkins, Iwan, and contact with friction
 *
 * A slider at z, reached through a spring k, holds up to L:
 *
 *     f = k (d - z),   z = d - clip(d - z_before, -L / k, L / k)              (1)
 *
 * which is the whole law: the slider stays while the spring can, and follows at its bound.  Iwan's
 * is a sum of (1).  In contact with friction L = mu N is that of the moment, N = max(0, preload +
 * kn d_n); without contact L = 0 and the slider follows.  (1) is exact for a monotone path from
 * z_before's instant to now with L constant.
 *
 * Over a period, (1) maps the slider's place at the start to that at the end by one clip: if d
 * ranges over less than 2 L / k, to the nearest of [d_max - L/k, d_min + L/k], where it then stays
 * for good; otherwise, whatever the start, at the largest d the slider has been dragged to d_max -
 * L/k, and from there its whole path is known.  Between turns of d the path is monotone: a stuck
 * slider begins to slip where d has left it by L/k, and sticks again at the next turn.  With a
 * limit that varies, stick ends where k d -+ mu kn d_n has risen or fallen by what was left, and
 * begins again where that sum turns; contact begins and ends where N = 0.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/law.h"
#include "modal/numbers.h"
#include "modal/scene/orbit.h"
#include "modal/scene/pieces.h"

struct sliders {
    int count;
    struct slider { double stiffness, limit; } element[];   /* N/m, N */
};

struct contact {
    double normal_stiffness, preload, tangential_stiffness, mu;   /* N/m, N, N/m, 1 */
    bool side;  /* of a contact whose normal force another law gives: f_0 = 0 */
};

/* (1): the force, true where the slider has moved */
static bool slide(double k, double L, double d, double *z, double *f)
{
    double trial = k * (d - *z);  /* the slider where it was */

    *f = trial;
    if (fabs(trial) <= L)
        return false;
    *f = copysign(L, trial);  /* (1): at its bound */
    *z = d - *f / k;  /* dragged along */
    return true;
}

/* The sum over the elements, each returned onto its limit. */
static enum modal_status sliders_force(const struct law *law, const struct law_point *at,
                                       struct law_force *out, struct modal_error *err)
{
    const struct sliders *s = law->data;

    (void)err;
    out->f[0] = out->fd[0][0] = out->fv[0][0] = 0;
    out->acts = false;
    out->regime = 0;
    for (int i = 0; i < s->count; i++) {
        double f, z = at->memory_before[i];
        bool slips = slide(s->element[i].stiffness, s->element[i].limit, at->d[0], &z, &f);

        out->f[0] += f;
        /* a slipping element has no stiffness */
        out->fd[0][0] += slips ? 0 : s->element[i].stiffness;
        out->acts |= slips;
        out->memory[i] = z;
        /* base 3, a digit an element; modulo a prime, past twelve */
        out->regime = 3 * out->regime % 1000003 + (slips ? f > 0 ? 1 : 2 : 0);
    }
    return MODAL_OK;
}

/* Normal spring first: the slider's limit is mu times what it gives now. */
static enum modal_status contact_force(const struct law *law, const struct law_point *at,
                                       struct law_force *out, struct modal_error *err)
{
    const struct contact *c = law->data;
    double N = fmax(0, c->preload + c->normal_stiffness * at->d[0]), z = at->memory_before[0], f;
    bool closed = N > 0, slips;  /* N = 0 is open: no force either way */

    (void)err;
    memset(out->fd, 0, sizeof out->fd);
    memset(out->fv, 0, sizeof out->fv);
    out->f[0] = c->side ? 0 : N;
    out->fd[0][0] = closed && !c->side ? c->normal_stiffness : 0;
    slips = slide(c->tangential_stiffness, c->mu * N, at->d[1], &z, &f);
    out->f[1] = f;
    /* d(mu N)/d d_n */
    out->fd[1][0] = slips && closed ? copysign(c->mu * c->normal_stiffness, f) : 0;
    out->fd[1][1] = slips || !closed ? 0 : c->tangential_stiffness;
    out->memory[0] = z;
    out->acts = c->preload > 0 ? slips || !closed : closed;  /* at rest it holds, or is open */
    out->regime = !closed ? 3 : slips ? f > 0 ? 1 : 2 : 0;
    return MODAL_OK;
}

/* A slider at rest: an elastic spring about where it was left. */
static enum modal_status stick_piece(const struct slider *e, double from, double to, double z,
                                     double at, struct law_pieces *out, struct modal_error *err)
{
    struct law_piece piece = { .from = from,
                               .to = to,
                               .level = -e->stiffness * z,
                               .gain = { e->stiffness },
                               .holds = true,
                               .starts = true,
                               .at = at,
                               .ref = { -e->stiffness } };

    return pieces_add(out, &piece, err);
}

/* A slider at its limit: a constant force. */
static enum modal_status slip_piece(double from, double to, double force, struct law_pieces *out,
                                    struct modal_error *err)
{
    struct law_piece piece = { .from = from, .to = to, .level = force };

    out->acts = true;
    return pieces_add(out, &piece, err);
}

/* Never slipping (or no motion at all): the place nearest 0 that the range of d allows. */
static enum modal_status stuck_slider(const struct slider *e, double reach, double low, double high,
                                      double at_low, double at_high, struct law_pieces *out,
                                      struct modal_error *err)
{
    /* the interval of the opening, clipped from 0 */
    double z = fmax(fmin(0, low + reach), high - reach);
    struct law_piece piece = { .to = 2 * M_PI,
                               .level = -e->stiffness * z,
                               .gain = { e->stiffness },
                               .holds = true,
                               .at = z < 0 ? at_low : at_high,
                               .ref = { z != 0 ? -e->stiffness : 0 } };

    out->undetermined = true;
    return pieces_add(out, &piece, err);
}

/* From the largest d on, once around. */
static enum modal_status moving_slider(const struct slider *e, const struct orbit *o, int top,
                                       double reach, struct law_pieces *out,
                                       struct modal_error *err)
{
    /* at the largest d: known, whatever came before */
    double z = o->turn[top].d - reach, began = o->turn[top].theta;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < o->turns; i++) {
        struct orbit_end from = orbit_turn_end(o, top + i), to = orbit_turn_end(o, top + i + 1);
        double d = to.d, slip;

        if (fabs(d - z) <= reach)  /* this branch does not reach its bound */
            continue;
        slip = orbit_crossing(o, from, to, z + copysign(reach, d - z));
        rc = stick_piece(e, began, slip, z, began, out, err);
        if (rc == MODAL_OK)
            rc = slip_piece(slip, to.theta, copysign(e->limit, d - z), out, err);
        z = d - copysign(reach, d - z);  /* dragged to the turn */
        began = to.theta;
    }
    if (rc == MODAL_OK && began < o->turn[top].theta + 2 * M_PI)
        rc = stick_piece(e, began, o->turn[top].theta + 2 * M_PI, z, began, out, err);
    return rc;
}

/* One element round the period, from turn to turn. */
static enum modal_status slider_pieces(const struct slider *e, const struct orbit *o,
                                       struct law_pieces *out, struct modal_error *err)
{
    /* L/k of the opening */
    double reach = e->stiffness > 0 ? e->limit / e->stiffness : HUGE_VAL, low, high;
    int top = 0, bottom = 0;

    if (e->stiffness == 0)
        return MODAL_OK;
    if (e->limit == 0) {
        out->acts = true;
        return MODAL_OK;                                   /* a slider without strength: no force */
    }
    if (o->turns < 2)
        return stuck_slider(e, reach, o->d[0], o->d[0], 0, 0, out, err);
    for (int i = 1; i < o->turns; i++) {
        top = o->turn[i].d > o->turn[top].d ? i : top;  /* the largest d */
        bottom = o->turn[i].d < o->turn[bottom].d ? i : bottom;  /* the least */
    }
    low = o->turn[bottom].d;
    high = o->turn[top].d;
    if (high - low <= 2 * reach)  /* never past both bounds: for good */
        return stuck_slider(e, reach, low, high, o->turn[bottom].theta, o->turn[top].theta, out,
                            err);
    return moving_slider(e, o, top, reach, out, err);
}

/* All elements: their pieces simply stand side by side. */
static enum modal_status sliders_pieces(const struct law *law, const struct orbit *const *input,
                                        struct law_pieces *out, struct modal_error *err)
{
    const struct sliders *s = law->data;
    enum modal_status rc = MODAL_OK;

    bool all = true;

    for (int i = 0; rc == MODAL_OK && i < s->count; i++) {
        int before = out->count;

        out->undetermined = false;
        rc = slider_pieces(&s->element[i], input[0], out, err);
        all &= out->undetermined || out->count == before;
        for (int e = before; e < out->count; e++)
            out->piece[e].slider = i;
    }
    out->undetermined = all && out->count > 0;
    return rc;
}

/* Contact with friction, walked from event to event. */
enum contact_mode { OPEN, STUCK, SLIPS_UP, SLIPS_DOWN };

struct contact_walk {
    const struct contact *c;
    const struct orbit *n, *t;            /* normal and tangential */
    struct orbit up, down;                /* k d_t - mu kn d_n, k d_t + mu kn d_n */
    enum contact_mode mode;  /* where the walk stands */
    double level, at, ref[2];             /* of the stick phase under way: (2) of pieces.h */
    bool holds_start;                     /* that phase began at `at`, not before the walk */
    struct law_pieces *out;               /* NULL: the first round, which only finds the start */
};

/* An event and what the walk asks there, and of the interval from it to the next: the same in every
 * round. */
struct contact_event {
    double theta, up[3], down[3];         /* the bounds' sums (orbit_at) */
    bool closed;                          /* from here to the next: N keeps its sign */
};

/* Stick or slip of the tangential element between two events of the normal force. */
static enum modal_status tangential(struct contact_walk *w, double from, double to,
                                    struct modal_error *err)
{
    const struct contact *c = w->c;
    double sign = w->mode == SLIPS_UP ? 1 : -1;
    struct law_piece piece = { .output = 1, .from = from, .to = to, .slider = 0 };

    if (w->out == NULL || w->mode == OPEN)
        return MODAL_OK;
    if (w->mode == STUCK) {
        piece.level = w->level;
        piece.gain[1] = c->tangential_stiffness;  /* an elastic spring about `level` */
        piece.holds = true;
        piece.starts = w->at == from && w->holds_start;
        piece.at = w->at;
        piece.ref[0] = w->ref[0];
        piece.ref[1] = w->ref[1];
    } else {
        piece.level = sign * c->mu * c->preload;  /* mu N, N linear in d_n */
        piece.gain[0] = sign * c->mu * c->normal_stiffness;
    }
    return pieces_add(w->out, &piece, err);
}

/* The slider comes to rest at THETA with force F = sign mu N (sign 0: a contact just closed). */
static void come_to_rest(struct contact_walk *w, double theta, double sign)
{
    double n[3], t[3], mu_k = sign * w->c->mu * w->c->normal_stiffness,
                       k = w->c->tangential_stiffness;

    orbit_at(w->n, theta, n);
    orbit_at(w->t, theta, t);
    w->mode = STUCK;
    w->at = theta;
    w->holds_start = true;  /* `at` is within this walk */
    w->level = sign * w->c->mu * w->c->preload + mu_k * n[0] - k * t[0];
    w->ref[0] = sign != 0 ? mu_k : n[1] != 0 ? k * t[1] / n[1] : 0;
    w->ref[1] = -k;  /* (2) of pieces.h */
}

/* The interval from FROM to TO, on which N keeps its sign and both bounds' sums are monotone. */
static enum modal_status contact_interval(struct contact_walk *w, const struct contact_event *from,
                                          const struct contact_event *to, struct modal_error *err)
{
    const double *ua = from->up, *ub = to->up, *da = from->down, *db = to->down;
    double a = from->theta, b = to->theta, high, low, event = b;
    enum contact_mode next = STUCK;
    enum modal_status rc;

    if (!from->closed) {
        w->mode = OPEN;
        return MODAL_OK;
    }
    if (w->mode == OPEN) {
        come_to_rest(w, a, 0);  /* contact made: N = 0, no force yet */
        w->mode = ub[0] > ua[0] ? SLIPS_UP : db[0] < da[0] ? SLIPS_DOWN : STUCK;
    } else if (w->mode == SLIPS_UP && ub[0] < ua[0])
        come_to_rest(w, a, 1);
    else if (w->mode == SLIPS_DOWN && db[0] > da[0])
        come_to_rest(w, a, -1);
    if (w->mode != STUCK)
        return tangential(w, a, b, err);
    high = w->c->mu * w->c->preload - w->level;                  /* up reaches it: f = mu N */
    low = -w->c->mu * w->c->preload - w->level;
    if (ub[0] > high) {
        next = SLIPS_UP;
        event = ua[0] < high ? orbit_crossing(&w->up, (struct orbit_end){ a, ua[0], ua[1] },
                                              (struct orbit_end){ b, ub[0], ub[1] }, high)
                             : a;
    }
    if (db[0] < low) {
        double other = da[0] > low ? orbit_crossing(&w->down, (struct orbit_end){ a, da[0], da[1] },
                                                    (struct orbit_end){ b, db[0], db[1] }, low)
                                   : a;

        if (next == STUCK || other < event) {
            next = SLIPS_DOWN;
            event = other;
        }
    }
    rc = tangential(w, a, event, err);
    w->mode = next;
    return rc == MODAL_OK && next != STUCK ? tangential(w, event, b, err) : rc;
}

/* Turns of both sums and crossings of N = 0, ascending, with the first again after a period; their
 * number.  THETA has room for MOST, as EVENT has. */
static int contact_events(struct contact_walk *w, double *theta, struct contact_event *event,
                          int most)
{
    int count = 0, closings = 0;

    for (int i = 0; i < w->up.turns && count < most - 1; i++)
        theta[count++] = w->up.turn[i].theta;
    for (int i = 0; i < w->down.turns && count < most - 1; i++)
        theta[count++] = w->down.turn[i].theta;
    if (w->c->normal_stiffness > 0 && w->n->turns >= 2)
        closings = orbit_crossings(w->n, -w->c->preload / w->c->normal_stiffness, theta + count,
                                   most - 1 - count);
    count += closings > 0 ? closings : 0;  /* -1: more than room, which cannot be */
    if (count == 0)
        theta[count++] = 0;
    numbers_sort(theta, (size_t)count);
    theta[count] = theta[0] + 2 * M_PI;  /* closes the round */
    for (int i = 0; i < count; i++) {
        double mid[3];

        event[i].theta = theta[i];
        orbit_at(&w->up, theta[i], event[i].up);
        orbit_at(&w->down, theta[i], event[i].down);
        orbit_at(w->n, 0.5 * (theta[i] + theta[i + 1]), mid);  /* one sign throughout */
        event[i].closed = w->c->preload + w->c->normal_stiffness * mid[0] > 0;
    }
    event[count] = event[0];
    event[count].theta = theta[count];
    return count;
}

/* The normal force, a spring where it is in contact. */
static enum modal_status normal_pieces(const struct contact *c, const struct contact_event *event,
                                       int count, struct law_pieces *out, struct modal_error *err)
{
    for (int i = 0; i < count; i++) {
        struct law_piece piece = { .from = event[i].theta, .to = event[i + 1].theta,
                                   .level = c->preload, .gain = { c->normal_stiffness },
                                   .slider = -1 };

        out->acts |= event[i].closed != (c->preload > 0);
        if (event[i].closed && !c->side && pieces_add(out, &piece, err) != MODAL_OK)
            return MODAL_NO_MEMORY;
    }
    return MODAL_OK;
}

/* Once round the period from one event to the next. */
static enum modal_status walk_round(struct contact_walk *w, const struct contact_event *event,
                                    int count, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < count; i++)
        rc = contact_interval(w, &event[i], &event[i + 1], err);
    w->at -= 2 * M_PI;  /* the round begins anew */
    w->holds_start = false;
    return rc;
}

/* Events of the normal force first, then the slider walked until its place repeats. */
static enum modal_status contact_pieces(const struct law *law, const struct orbit *const *input,
                                        struct law_pieces *out, struct modal_error *err)
{
    const struct contact *c = law->data;
    struct contact_walk w = { .c = c, .n = input[0], .t = input[1], .mode = STUCK };
    double mu_k = c->mu * c->normal_stiffness, *theta = NULL;
    struct contact_event *event = NULL;
    enum modal_status rc;
    int count, most, before;

    rc = orbit_init(&w.up, input[0]->H, input[0]->N, err);
    if (rc == MODAL_OK)
        rc = orbit_init(&w.down, input[0]->H, input[0]->N, err);
    if (rc != MODAL_OK)
        goto out;
    orbit_combine(&w.up, c->tangential_stiffness, w.t, -mu_k, w.n);  /* its turns end slipping up */
    orbit_combine(&w.down, c->tangential_stiffness, w.t, mu_k, w.n);  /* and down */
    if ((rc = orbit_find_turns(&w.up, err)) != MODAL_OK
        || (rc = orbit_find_turns(&w.down, err)) != MODAL_OK)
        goto out;
    /* all events of a period, and the first again */
    most = w.up.turns + w.down.turns + w.n->turns + 2;
    event = malloc((size_t)most * sizeof *event);
    theta = malloc((size_t)most * sizeof *theta);
    if (event == NULL || theta == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "contact_friction: no memory for %d events", most);
        goto out;
    }
    count = contact_events(&w, theta, event, most);
    rc = normal_pieces(c, event, count, out, err);
    /* a slider left at 0; by then periodic, as (1) clips */
    for (int round = 0; rc == MODAL_OK && round < 2; round++)
        rc = walk_round(&w, event, count, err);
    w.out = out;
    before = out->count;
    if (rc == MODAL_OK)
        rc = walk_round(&w, event, count, err);
    out->undetermined =
        rc == MODAL_OK && c->mu > 0 && c->tangential_stiffness > 0 && out->count > before;
    for (int i = before; i < out->count; i++)
        if (!out->piece[i].holds || out->piece[i].starts)
            out->undetermined = false;
    out->acts |= out->count > before && !out->undetermined;
out:
    free(event);
    free(theta);
    orbit_done(&w.up);
    orbit_done(&w.down);
    return rc;
}

/* No slider leaves 0. */
static bool sliders_stay(const struct law *law, const double *mean, const double *reach)
{
    const struct sliders *s = law->data;

    for (int i = 0; i < s->count; i++)
        if (s->element[i].stiffness * (fabs(mean[0]) + reach[0]) > s->element[i].limit)
            return false;
    return true;
}

/* Open at rest and throughout; or closed, and the slider holds where N is least. */
static bool contact_stays(const struct law *law, const double *mean, const double *reach)
{
    const struct contact *c = law->data;
    double least = c->preload + c->normal_stiffness * (mean[0] - reach[0]);

    if (c->preload <= 0)
        return c->preload + c->normal_stiffness * (mean[0] + reach[0]) <= 0;
    return least > 0 && c->tangential_stiffness * (fabs(mean[1]) + reach[1]) <= c->mu * least;
}

static double sliders_stiffest(const struct law *law)
{
    const struct sliders *s = law->data;
    double most = 0;

    for (int i = 0; i < s->count; i++)
        most = fmax(most, s->element[i].stiffness);
    return most;
}

static enum modal_status sliders_soften(const struct law *law, double most, struct law *out,
                                        struct modal_error *err)
{
    const struct sliders *s = law->data;
    double stiffness[LAW_TERMS_MOST], limit[LAW_TERMS_MOST];

    for (int i = 0; i < s->count; i++) {
        stiffness[i] = fmin(s->element[i].stiffness, most);
        limit[i] = s->element[i].limit;
    }
    return law_iwan(stiffness, limit, s->count, out, err);
}

static const struct law_class jenkins_class = {
    .name = "friction", .inputs = 1, .force = sliders_force, .pieces = sliders_pieces,
    .stays = sliders_stay, .stiffest = sliders_stiffest, .soften = sliders_soften
};
static const struct law_class iwan_class = {
    .name = "iwan", .inputs = 1, .force = sliders_force, .pieces = sliders_pieces,
    .stays = sliders_stay, .stiffest = sliders_stiffest, .soften = sliders_soften
};
static const struct law_class contact_class = {
    .name = "contact_friction", .inputs = 2, .force = contact_force, .pieces = contact_pieces,
    .stays = contact_stays
};

/* One class for one element and for many: memory is a place each. */
static enum modal_status sliders_new(const struct law_class *kind, const double *stiffness,
                                     const double *limit, int count, struct law *out,
                                     struct modal_error *err)
{
    struct sliders *s;

    if (count < 1 || count > LAW_TERMS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stiffnesses",
                                "%d sliders; accepted: 1 to %d", count, LAW_TERMS_MOST);
    for (int i = 0; i < count; i++)
        if (law_check("stiffness", stiffness[i], 0, err) != MODAL_OK
            || law_check("limit", limit[i], 0, err) != MODAL_OK)
            return MODAL_BAD_INPUT;
    s = malloc(sizeof *s + (size_t)count * sizeof s->element[0]);
    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "sliders: no memory for %d", count);
    s->count = count;
    for (int i = 0; i < count; i++)
        /* copied: the caller frees its lists */
        s->element[i] = (struct slider) { stiffness[i], limit[i] };
    law_clear(out, kind);  /* ground to ground, until it is placed */
    out->data = s;
    out->memory = count;
    for (int i = 0; i < count; i++)
        out->limit += limit[i];  /* of all side by side */
    return MODAL_OK;
}

enum modal_status law_jenkins(double stiffness, double limit, struct law *out,
                              struct modal_error *err)
{
    return sliders_new(&jenkins_class, &stiffness, &limit, 1, out, err);
}

enum modal_status law_iwan(const double *stiffness, const double *limit, int count, struct law *out,
                           struct modal_error *err)
{
    return sliders_new(&iwan_class, stiffness, limit, count, out, err);
}

/* Both laws of a contact. */
static enum modal_status contact_new(double normal_stiffness, double preload,
                                     double tangential_stiffness, double mu, bool side,
                                     struct law *out, struct modal_error *err)
{
    struct contact *c;

    if (law_check("normal_stiffness", normal_stiffness, 0, err) != MODAL_OK
        || law_check("preload", preload, -1e300, err) != MODAL_OK
        || law_check("tangential_stiffness", tangential_stiffness, 0, err) != MODAL_OK
        || law_check("mu", mu, 0, err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    c = malloc(sizeof *c);
    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "contact_friction: no memory");
    *c = (struct contact) { normal_stiffness, preload, tangential_stiffness, mu, side };
    law_clear(out, &contact_class);
    out->data = c;
    out->memory = 1;  /* the slider's place */
    return MODAL_OK;
}

enum modal_status law_contact_friction(double normal_stiffness, double preload,
                                       double tangential_stiffness, double mu, struct law *out,
                                       struct modal_error *err)
{
    return contact_new(normal_stiffness, preload, tangential_stiffness, mu, false, out, err);
}

enum modal_status law_contact_side(double normal_stiffness, double preload,
                                   double tangential_stiffness, double mu, struct law *out,
                                   struct modal_error *err)
{
    return contact_new(normal_stiffness, preload, tangential_stiffness, mu, true, out, err);
}
