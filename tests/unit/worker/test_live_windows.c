/* What a worker keeps of live windows between one RUN and the next: records of two decaying modes
 * whose poles are known */
#include "check.h"
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "signals.h"
#include "worker/live_windows.h"

enum { WINDOW = 120, CHANNELS = 2 };
static const double DT = 0.05;

/* Sample K of stream NUMBER, of two channels: modes of 1.1 and 3.2 Hz, and noise of its own. */
static void sample(int number, long k, double *y)
{
    const double tau = 6.283185307179586, t = (double)k * DT;
    const double slow = exp(-0.02 * t), fast = exp(-0.03 * t) * cos(3.2 * tau * t);
    struct random r = { (uint64_t)number << 32 | (uint64_t)k };

    y[0] = slow * cos(1.1 * tau * t + number) + 0.5 * fast + 1e-3 * random_normal(&r);
    y[1] = slow * sin(1.1 * tau * t + number) - 0.3 * fast + 1e-3 * random_normal(&r);
}

struct answer { enum modal_status status; bool updated; double frequency; };

/* What the last COUNT samples up to number TO of stream NUMBER give. */
static struct answer run(struct live_windows *windows, int number, long to, int count, int epoch)
{
    static double rows[WINDOW * CHANNELS];
    struct batch batch = { .samples = (size_t)count, .channels = CHANNELS, .signals = rows,
                           .dt = DT };
    cJSON *live = cJSON_CreateObject(), *document = NULL;
    struct answer a = { .frequency = NAN };
    char name[32];

    snprintf(name, sizeof name, "%d", number);
    cJSON_AddStringToObject(live, "stream", name);
    cJSON_AddNumberToObject(live, "epoch", epoch);
    cJSON_AddNumberToObject(live, "to", (double)to);
    cJSON_AddNumberToObject(live, "window", WINDOW);
    cJSON_AddNumberToObject(live, "hop", 20);
    for (int i = 0; i < count; i++)
        sample(number, to + 1 - count + i, rows + (ptrdiff_t)i * CHANNELS);
    a.status = live_windows_run(windows, live, NULL, &batch, &document, NULL);
    if (a.status == MODAL_OK) {
        const cJSON *update = cJSON_GetObjectItem(document, "update");
        const cJSON *first = cJSON_GetArrayItem(cJSON_GetObjectItem(document, "modes"), 0);
        a.updated = cJSON_IsTrue(cJSON_GetObjectItem(update, "updated"));
        a.frequency = cJSON_GetNumberValue(cJSON_GetObjectItem(first, "frequency_hz"));
    }
    cJSON_Delete(document);
    cJSON_Delete(live);
    return a;
}

/* Four turns: all but a few of the later ones go on. */
TEST(of_three_hundred_streams_in_turn_each_goes_on_with_its_own_window)
{
    enum { STREAMS = 300, TURNS = 4 };
    struct live_windows *windows = live_windows_new();
    int updated = 0;

    for (int turn = 0; turn < TURNS; turn++)
        for (int number = 0; number < STREAMS; number++) {
            struct answer a = run(windows, number, WINDOW - 1 + 20 * turn,
                                  turn == 0 ? WINDOW : 20, 0);
            CHECK(a.status == MODAL_OK);
            CHECK_NEAR(a.frequency, 1.1, 0.01);
            updated += a.updated;
        }
    CHECK(updated > STREAMS * (TURNS - 1) * 9 / 10);
    live_windows_free(windows);
}

TEST(a_whole_window_behind_a_hole_begins_at_the_poles_of_the_last_one_here)
{
    struct live_windows *windows = live_windows_new();
    struct answer a = run(windows, 7, WINDOW - 1, WINDOW, 0);

    CHECK(a.status == MODAL_OK && !a.updated);
    a = run(windows, 7, 3 * WINDOW, WINDOW, 0);
    CHECK(a.status == MODAL_OK && a.updated);
    CHECK_NEAR(a.frequency, 1.1, 0.01);
    a = run(windows, 7, 3 * WINDOW + 20, 20, 0);
    CHECK(a.status == MODAL_OK && a.updated);
    live_windows_free(windows);
}

TEST(samples_that_do_not_follow_and_are_no_whole_window_are_not_found)
{
    struct live_windows *windows = live_windows_new();

    CHECK(run(windows, 7, 500, 20, 0).status == MODAL_NOT_FOUND);
    CHECK(run(windows, 7, WINDOW - 1, WINDOW, 0).status == MODAL_OK);
    CHECK(run(windows, 7, WINDOW + 20, 20, 0).status == MODAL_NOT_FOUND);     /* one is missing */
    CHECK(run(windows, 7, WINDOW + 40, 20, 0).status == MODAL_NOT_FOUND);     /* it was forgotten */
    CHECK(run(windows, 7, WINDOW - 1, WINDOW, 0).status == MODAL_OK);
    CHECK(run(windows, 7, WINDOW + 19, 20, 1).status == MODAL_NOT_FOUND);     /* another epoch */
    live_windows_free(windows);
}
