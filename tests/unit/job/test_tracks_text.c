/* What is known of tracks, as text: nothing that decides is lost, and no other text is one. */
#include "job/tracks_text.h"
#include "check.h"
#include "signals.h"

enum { LENGTH = 400, HOP = 200, MODES = 4 };

/* Four modes in three channels, one of which is missed now and then. */
static int window(struct random *r, int k, struct track_mode *seen)
{
    int count = 0;

    for (int i = 0; i < MODES; i++) {
        struct track_mode m = { .std_re = 1e-3, .std_im = 1e-3 };
        double complex shape[3];

        for (int c = 0; c < 3; c++)
            shape[c] = CMPLX(cos(i + c), 0.1 * random_normal(r));
        track_shape(shape, 3, m.shape);
        m.exponent = decay_pole(1 + i + 0.002 * k * i, 0.01)
            + 1e-3 * CMPLX(random_normal(r), random_normal(r));
        if (i > 0 || k % 5 != 4)
            seen[count++] = m;
    }
    return count;
}

TEST(windows_that_go_on_from_text_number_modes_as_windows_that_go_on_from_memory)
{
    static struct tracks memory, read;
    struct random r = { 5 };
    char *text = NULL;

    memory = (struct tracks) { 0 }, read = (struct tracks) { 0 };
    for (int k = 0; k < 40; k++) {
        struct track_window w = { 0, (uint64_t)(k * HOP), (uint64_t)(k * HOP + LENGTH - 1), 0.05 };
        struct track_mode seen[MODES];
        struct track_edge edges[2 * TRACKS_MOST];
        int64_t ours[MODES], theirs[MODES];
        int count = window(&r, k, seen), some, others;

        if (text != NULL)
            CHECK(tracks_text_read(text, &read, NULL) == MODAL_OK);
        CHECK(tracks_follow(&memory, &w, seen, count, ours, edges, &some, NULL) == MODAL_OK);
        CHECK(tracks_follow(&read, &w, seen, count, theirs, edges, &others, NULL) == MODAL_OK);
        CHECK(memcmp(ours, theirs, sizeof *ours * (size_t)count) == 0 && some == others);
        free(text);
        text = tracks_text_write(&read);
        CHECK(text != NULL);
    }
    CHECK(read.count == MODES && read.next == MODES);
    free(text);
}

/* Value and slope err alike, and a window knows the value but for rounding: what is left of the
 * slope's variance is none, and came out below 0 for some of these.  Then no window was told any
 * more that a worker had anew. */
TEST(tracks_of_a_drift_whose_value_becomes_known_exactly_are_read_again)
{
    static struct tracks t, read;

    for (int i = 0; i < 200; i++) {
        const double both = 1e-3 * (1 + 0.37 * i), value = both * (0.3 + 0.01 * i);
        struct track_error e = { value, both, both * both / value };
        struct track_window w = { 0, HOP, HOP + LENGTH - 1, 0.05 };
        struct track_mode m = { .exponent = decay_pole(1, 0.01) };
        struct track_way way = { m.exponent, 1e-6, e, e, 2, 2 };
        struct track_edge edges[2 * TRACKS_MOST];
        int64_t number;
        int some;
        char *text;

        t = (struct tracks) { .next = 1, .begun = true, .to = LENGTH - 1, .first_to = LENGTH - 1,
                              .count = 1 };
        t.track[0] = (struct track) { .line = way, .still = way, .stays = 0.1, .shown = 3,
                                      .asked = 3, .last = LENGTH - 1, .since = LENGTH - 1,
                                      .shape_freedom = 2, .shape_misfit = 0.1 };
        t.track[0].still.re.value = t.track[0].still.im.value = 1e-9;
        t.track[0].still.exponent -= 1e-2;
        CHECK(tracks_follow(&t, &w, &m, 1, &number, edges, &some, NULL) == MODAL_OK);
        CHECK((text = tracks_text_write(&t)) != NULL);
        CHECK(tracks_text_read(text, &read, NULL) == MODAL_OK && read.count == 1);
        free(text);
    }
}

TEST(text_that_no_window_left_is_refused)
{
    static const char *const bad[] = {
        "", "2", "3 0 0 0 0 0 0 0", "0 0 0 0 0 0 0 0", "1.5 0 0 0 0 0 0 0",
        "2 0 0 0 0 0 0 257", "2 0 0 0 0 0 0 -1", "2 0.5 0 0 0 0 0 0", "2 0 nan 0 0 0 0 0",
    };
    struct modal_error err;
    static struct tracks t;

    t = (struct tracks) { .next = 7 };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        CHECK(tracks_text_read(bad[i], &t, &err) == MODAL_BAD_INPUT);
        CHECK(strcmp(err.field, "tracks") == 0 && t.next == 7 && t.count == 0);
    }
    CHECK(tracks_text_read("2 0 0 0 0 0 0 0", &t, &err) == MODAL_OK && t.next == 0);
}

TEST(tracks_that_no_window_left_begin_anew_and_their_numbers_go_on)
{
    static const char *const bad[] = {
        "2 3 0 0 0 0 0 1", "2 3 0 0 0 0 0 0 5", "2 3 0 0 0 0 0 0x",
        "2 3 0 9 9 0 0 1 -1 6 -1 1 2 2 0 0 0 1 0 1 -1 6 1 1 2 2 0 1 1 2 1 9 9 0 0 0.5"
        " 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0",                          /* a variance below 0 */
    };
    static struct tracks t;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        t = (struct tracks) { .next = 7, .count = 1, .begun = true };
        CHECK(tracks_text_read(bad[i], &t, NULL) == MODAL_OK);
        CHECK(t.next == 3 && t.count == 0 && !t.begun);
    }
}

TEST(tracks_of_an_earlier_version_begin_anew_and_their_numbers_go_on)
{
    static struct tracks t;

    CHECK(tracks_text_read("1 7 2 9 99 0.5 3 1 6 -1 6 0 0", &t, NULL) == MODAL_OK);
    CHECK(t.next == 7 && t.count == 0 && !t.begun);
}
