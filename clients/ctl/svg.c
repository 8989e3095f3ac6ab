/* svg.c - see svg.h */
#include "svg.h"
#include <float.h>
#include <math.h>

/* A panel, in pixels. */
enum {
    WIDTH = 520,         /* three panels fit a wide screen */
    HEIGHT = 380,        /* about 4 : 3 within its frame */
    LEFT = 76,           /* room for seven digits, and the label upright */
    RIGHT = 16,          /* for half a digit */
    TOP = 34,            /* for the title */
    BOTTOM = 54          /* for digits and label */
};
/* Parts of their size within which values are one: neighbours are too far apart for ticks between
 * them. */
static const double ONE_VALUE = 1e-9;

static const char *const strokes[] = {
    [SVG_SOLID]  = "stroke=\"#1f4e79\" stroke-width=\"1.6\"",
    [SVG_DASHED] = "stroke=\"#b03a2e\" stroke-width=\"1.6\" stroke-dasharray=\"6 4\"",
    [SVG_THIN]   = "stroke=\"#888888\" stroke-width=\"0.8\"",
    [SVG_SECOND] = "stroke=\"#c87f0a\" stroke-width=\"1.2\"",
};

void svg_hold(struct svg_axis *axis, double value)
{
    if (!isfinite(value) || (axis->logarithmic && value <= 0))
        return;
    bool empty = axis->low > axis->high;
    if (empty || value < axis->low)
        axis->low = value;
    if (empty || value > axis->high)
        axis->high = value;
}

/* Names and messages are others': no markup, and no control characters, which no XML may have. */
static void escape(FILE *file, const char *text)
{
    for (; *text != 0; text++)
        switch ((unsigned char)*text < ' ' ? 0 : *text) {
        case 0: fputs("\xef\xbf\xbd", file); break;
        case '<': fputs("&lt;", file); break;
        case '>': fputs("&gt;", file); break;
        case '&': fputs("&amp;", file); break;
        default: fputc(*text, file);
        }
}

void svg_begin(struct svg *svg, FILE *file, int panels, const char *title)
{
    *svg = (struct svg) { file, -1 };
    fprintf(file,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" "
            "font-family=\"sans-serif\" font-size=\"12\">\n"
            "<rect width=\"100%%\" height=\"100%%\" fill=\"white\"/>\n<text x=\"%d\" y=\"20\" "
            "font-size=\"14\">",
            WIDTH * panels, HEIGHT, LEFT);
    escape(file, title);
    fputs("</text>\n", file);
}

void svg_end(struct svg *svg)
{
    fputs("</svg>\n", svg->file);
}

static double part(const struct svg_axis *a, double value)
{
    return a->logarithmic ? (log(value) - log(a->low)) / (log(a->high) - log(a->low))
                          : (value - a->low) / (a->high - a->low);
}

/* Has Y at X a place?  Not what is no number or, on a logarithmic axis, not positive, nor any where
 * the range itself is beyond numbers. */
static bool drawable(const struct svg_panel *p, double x, double y)
{
    return isfinite(part(&p->x, x)) && isfinite(part(&p->y, y));
}

static double place_x(const struct svg *svg, const struct svg_panel *p, double x)
{
    return svg->panel * WIDTH + LEFT + part(&p->x, x) * (WIDTH - LEFT - RIGHT);
}

static double place_y(const struct svg_panel *p, double y)
{
    return HEIGHT - BOTTOM - part(&p->y, y) * (HEIGHT - TOP - BOTTOM);
}

/* A range that can be drawn, with a little room around it. */
static void widen(struct svg_axis *a)
{
    if (a->low > a->high)
        a->low = a->high = a->logarithmic ? 1 : 0;
    if (a->logarithmic) {
        a->low = a->low > 0 ? a->low / 1.3 : 1e-3;
        a->high = a->high > a->low ? fmin(a->high * 1.3, DBL_MAX) : a->low * 10;
        return;
    }
    double most = fmax(fabs(a->low), fabs(a->high));
    double room = a->high - a->low > ONE_VALUE * most ? 0.05 * (a->high - a->low)
                  : most > 0                     ? 0.1 * most
                                                 : 1;
    a->low -= room;
    a->high += room;
}

/* 1, 2 or 5 times a power of ten, about five to an axis. */
static double tick_step(double range)
{
    double power = pow(10, floor(log10(range / 5))), rest = range / 5 / power;

    static const struct { double below, step; } steps[] = { { 1.5, 1 }, { 3.5, 2 }, { 7.5, 5 } };

    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        if (rest < steps[i].below)
            return power * steps[i].step;
    return power * 10;
}

static void tick(const struct svg *svg, const struct svg_panel *p, bool horizontal, double value)
{
    double x = horizontal ? place_x(svg, p, value) : svg->panel * WIDTH + LEFT,
           y = horizontal ? HEIGHT - BOTTOM : place_y(p, value);

    fprintf(svg->file, "<path d=\"M%.1f %.1f%s\" stroke=\"#dddddd\"/>", x, y,
            horizontal ? "V34" : "h428");
    fprintf(svg->file, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%.6g</text>\n",
            horizontal ? x : x - 6, horizontal ? y + 16 : y + 4, horizontal ? "middle" : "end",
            value + 0.0); /* no -0 */
}

/* Powers of ten, at most about eight, with 2 and 5 times them where they are fewer than three. */
static void ticks_of_decades(const struct svg *svg, const struct svg_panel *p, bool horizontal)
{
    static const double digits[] = { 1, 2, 5 };
    const struct svg_axis *a = horizontal ? &p->x : &p->y;
    double first = ceil(log10(a->low)), last = floor(log10(a->high)),
           every = fmax(1, ceil((last - first) / 8));
    int count = last - first < 2 ? 3 : 1;

    for (double e = count > 1 ? first - 1 : first; e <= last; e += every)
        for (int i = 0; i < count; i++)
            if (digits[i] * pow(10, e) >= a->low && digits[i] * pow(10, e) <= a->high)
                tick(svg, p, horizontal, digits[i] * pow(10, e));
}

/* Within less than a decade logarithms have steps like any other; a range beyond numbers has
 * none. */
static void ticks(const struct svg *svg, const struct svg_panel *p, bool horizontal)
{
    const struct svg_axis *a = horizontal ? &p->x : &p->y;
    double range = a->high - a->low, step = tick_step(range);

    if (!isfinite(range))
        return;
    if (a->logarithmic && a->high >= 10 * a->low) {
        ticks_of_decades(svg, p, horizontal);
        return;
    }
    for (double k = ceil(a->low / step); k * step <= a->high; k++)
        tick(svg, p, horizontal, k == 0 ? 0 : k * step);
}

void svg_panel(struct svg *svg, struct svg_panel *p)
{
    int left = ++svg->panel * WIDTH + LEFT;

    widen(&p->x);
    widen(&p->y);
    ticks(svg, p, true);
    ticks(svg, p, false);
    fprintf(svg->file,
            "<rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" fill=\"none\" stroke=\"black\"/>\n",
            left, TOP, WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
    fprintf(
        svg->file,
        "<clipPath id=\"c%d\"><rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\"/></clipPath>\n",
        svg->panel, left, TOP, WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
    fprintf(svg->file, "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">",
            left + (WIDTH - LEFT - RIGHT) / 2, HEIGHT - 14);
    escape(svg->file, p->x.label);
    fprintf(svg->file,
            "</text>\n<text transform=\"translate(%d %d) rotate(-90)\" text-anchor=\"middle\">",
            left - 60, TOP + (HEIGHT - TOP - BOTTOM) / 2);
    escape(svg->file, p->y.label);
    fputs("</text>\n", svg->file);
}

void svg_line(const struct svg *svg, const struct svg_panel *p, const double *x, const double *y,
              int count, enum svg_style style)
{
    bool open = false;

    fprintf(svg->file, "<path clip-path=\"url(#c%d)\" fill=\"none\" %s d=\"", svg->panel,
            strokes[style]);
    for (int i = 0; i < count; i++) {
        bool good = drawable(p, x[i], y[i]);
        if (good)
            fprintf(svg->file, "%s%.2f %.2f", open ? "L" : "M", place_x(svg, p, x[i]),
                    place_y(p, y[i]));
        open = good;
    }
    fputs("\"/>\n", svg->file);
}

void svg_dot(const struct svg *svg, const struct svg_panel *p, double x, double y, bool filled)
{
    if (drawable(p, x, y))
        fprintf(svg->file,
                "<circle clip-path=\"url(#c%d)\" cx=\"%.2f\" cy=\"%.2f\" r=\"3.2\" fill=\"%s\" "
                "stroke=\"#1f4e79\"/>\n",
                svg->panel, place_x(svg, p, x), place_y(p, y), filled ? "#1f4e79" : "white");
}

void svg_bar(const struct svg *svg, const struct svg_panel *p, double x, double y, double dx,
             double dy)
{
    if (dx > 0 && isfinite(dx))
        svg_line(svg, p, (double[]) { x - dx, x + dx }, (double[]) { y, y }, 2, SVG_SOLID);
    if (dy > 0 && isfinite(dy))
        svg_line(svg, p, (double[]) { x, x }, (double[]) { y - dy, y + dy }, 2, SVG_SOLID);
}

void svg_shade(const struct svg *svg, const struct svg_panel *p, double x0, double y0, double x1,
               double y1, const char *colour)
{
    if (!drawable(p, x0, y0) || !drawable(p, x1, y1))
        return;
    fprintf(svg->file,
            "<rect clip-path=\"url(#c%d)\" x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\" "
            "fill=\"%s\"/>\n",
            svg->panel, place_x(svg, p, x0), place_y(p, y1),
            place_x(svg, p, x1) - place_x(svg, p, x0), place_y(p, y0) - place_y(p, y1), colour);
}

void svg_text(const struct svg *svg, const struct svg_panel *p, double x, double y,
              enum svg_side side, const char *text)
{
    bool before = side == SVG_BELOW_BEFORE;

    if (!drawable(p, x, y))
        return;
    fprintf(svg->file, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">",
            place_x(svg, p, x) + (before ? -5 : 5), place_y(p, y) + (before ? 15 : -5),
            before ? "end" : "start");
    escape(svg->file, text);
    fputs("</text>\n", svg->file);
}
