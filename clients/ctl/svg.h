/* svg.h - a picture of panels side by side, each with two axes: lines, dots, bars, shades */
#ifndef CTL_SVG_H
#define CTL_SVG_H
#include <stdbool.h>
#include <stdio.h>

struct svg { FILE *file; int panel; };

struct svg_axis { const char *label; double low, high; bool logarithmic; };

/* One panel's frame; points outside it are cut off. */
struct svg_panel { struct svg_axis x, y; };

enum svg_style { SVG_SOLID, SVG_DASHED, SVG_THIN, SVG_SECOND };

/* A picture of so many PANELS under TITLE into FILE, which stays the caller's; a failed write is
 * FILE's to tell. */
void svg_begin(struct svg *svg, FILE *file, int panels, const char *title);
/* The end of the picture; FILE stays open. */
void svg_end(struct svg *svg);
/* Frame, ticks and labels of the next panel; degenerate ranges are widened. */
void svg_panel(struct svg *svg, struct svg_panel *panel);
/* Through COUNT points, within the frame. */
void svg_line(const struct svg *svg, const struct svg_panel *panel, const double *x,
              const double *y, int count, enum svg_style style);
/* One point; open where it is not FILLED. */
void svg_dot(const struct svg *svg, const struct svg_panel *panel, double x, double y, bool filled);
/* A bar of half-length DX or DY (0: none). */
void svg_bar(const struct svg *svg, const struct svg_panel *panel, double x, double y, double dx,
             double dy);
/* A rectangle between two corners. */
void svg_shade(const struct svg *svg, const struct svg_panel *panel, double x0, double y0,
               double x1, double y1, const char *colour);
/* TEXT beside a place: what names a point stands above it and after it, what names a line's right
 * end below it and before it. */
enum svg_side { SVG_ABOVE_AFTER, SVG_BELOW_BEFORE };

/* TEXT at its SIDE of a place. */
void svg_text(const struct svg *svg, const struct svg_panel *panel, double x, double y,
              enum svg_side side, const char *text);
/* Make AXIS hold VALUE: ranges begin as low > high. */
void svg_hold(struct svg_axis *axis, double value);

#endif
