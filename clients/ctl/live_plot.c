/* live_plot.c - see live_plot.h; of several epochs the picture shows the last that was told */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "field.h"
#include "live_plot.h"
#include "svg.h"
#include "whole_file.h"

static const struct svg_axis empty = { NULL, HUGE_VAL, -HUGE_VAL, false };

static bool add_window(struct live_plot *plot, const cJSON *event)
{
    const cJSON *modes = cJSON_GetObjectItemCaseSensitive(event, "modes"), *mode;
    bool unstable = cJSON_IsFalse(
        cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(event, "stability"),
                                         "stable"));
    double dt = field_real(event, "dt"), to = field_real(event, "to");
    double at = isnan(dt) ? to : dt * to, epoch = field_number(event, "epoch", 0);

    if (!cJSON_IsArray(modes) || isnan(at))
        return false;
    if (epoch != plot->epoch || (plot->count > 0 && at < plot->dots[plot->count - 1].at))
        /* another epoch, or another stream of that name */
        plot->count = 0;
    plot->epoch = epoch;
    plot->seconds = !isnan(dt);
    cJSON_ArrayForEach(mode, modes) {
        const cJSON *std = cJSON_GetObjectItemCaseSensitive(mode, "std");
        struct live_dot dot = { at,
                                field_real(mode, "frequency_hz"),
                                field_number(std, "frequency_hz", 0),
                                field_real(mode, "damping_ratio"),
                                field_number(std, "damping_ratio", 0),
                                field_real(mode, "track"),
                                unstable };
        if (isnan(dot.hertz) || isnan(dot.zeta))
            continue;
        if (plot->count == LIVE_DOTS)
            memmove(plot->dots, plot->dots + 1, sizeof *plot->dots * (size_t)--plot->count);
        plot->dots[plot->count++] = dot;
    }
    return true;
}

static double height(const struct live_dot *d, bool damping)
{
    return damping ? d->zeta : d->hertz;
}

/* From each dot to the next one of its track. */
static void draw_tracks(struct svg *svg, const struct svg_panel *p, const struct live_plot *plot,
                        bool damping)
{
    const struct live_dot *end = plot->dots + plot->count;

    for (const struct live_dot *d = plot->dots; d < end; d++) {
        const struct live_dot *next = d + 1;
        while (next < end && next->track != d->track)
            next++;
        if (next < end)
            svg_line(svg, p, (double[]) { d->at, next->at },
                     (double[]) { height(d, damping), height(next, damping) }, 2, SVG_THIN);
    }
}

static void draw(struct svg *svg, const struct live_plot *plot, const char *label, bool damping)
{
    struct svg_panel p = { empty, empty };

    p.x.label = plot->seconds ? "end of the window, s" : "last sample", p.y.label = label;
    for (const struct live_dot *d = plot->dots; d < plot->dots + plot->count; d++) {
        double y = height(d, damping), bar = damping ? d->zeta_std : d->hertz_std;
        svg_hold(&p.x, d->at);
        svg_hold(&p.y, y - bar), svg_hold(&p.y, y + bar);
    }
    svg_hold(&p.x, 0);
    if (damping || plot->count == 0)
        svg_hold(&p.y, 0);
    svg_panel(svg, &p);
    if (damping)
        svg_line(svg, &p, (double[]) { p.x.low, p.x.high }, (double[]) { 0, 0 }, 2, SVG_THIN);
    draw_tracks(svg, &p, plot, damping);
    for (const struct live_dot *d = plot->dots; d < plot->dots + plot->count; d++) {
        double y = height(d, damping);
        svg_bar(svg, &p, d->at, y, 0, damping ? d->zeta_std : d->hertz_std);
        svg_dot(svg, &p, d->at, y, !d->unstable);
    }
}

enum modal_status live_plot_add(struct live_plot *plot, const char *path, const cJSON *event,
                                struct modal_error *err)
{
    char title[256];
    struct whole_file out;
    struct svg svg;

    if (!add_window(plot, event))
        return MODAL_OK;
    if (whole_file_begin(&out, path, "plot", err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    snprintf(title, sizeof title, "%s, epoch %.0f; open: unstable",
             field_word(event, "stream", "-"), field_number(event, "epoch", 0));
    svg_begin(&svg, out.file, 2, title);
    draw(&svg, plot, "frequency, Hz", false);
    draw(&svg, plot, "damping ratio", true);
    svg_end(&svg);
    return whole_file_end(&out, err);
}
