/* files.c - see files.h; WEB_FOLDER, where the files lie at the build, comes from CMake */
#include "files.h"
#include <string.h>

/* The bytes of FILE between SYMBOL_begin and SYMBOL_end. */
#define BUILT_IN(symbol, file) \
    __asm__(".section .rodata\n" #symbol "_begin: .incbin \"" WEB_FOLDER "/" file "\"\n" \
            #symbol "_end: .byte 0\n.previous\n"); \
    extern const char symbol##_begin[], symbol##_end[]

BUILT_IN(web_style, "page.css");
BUILT_IN(web_script, "page.js");
BUILT_IN(web_icon, "icon.svg");
BUILT_IN(web_uplot, "uplot/uPlot.iife.min.js");
BUILT_IN(web_uplot_style, "uplot/uPlot.min.css");
BUILT_IN(web_uplot_licence, "uplot/LICENSE");

const struct file *file_find(const char *name)
{
    static const struct file files[] = {
        { "page.css", "text/css; charset=utf-8", web_style_begin, web_style_end },
        { "page.js", "text/javascript; charset=utf-8", web_script_begin, web_script_end },
        { "icon.svg", "image/svg+xml", web_icon_begin, web_icon_end },
        { "uPlot.iife.min.js", "text/javascript; charset=utf-8", web_uplot_begin, web_uplot_end },
        { "uPlot.min.css", "text/css; charset=utf-8", web_uplot_style_begin, web_uplot_style_end },
        { "uPlot.LICENSE", "text/plain; charset=utf-8", web_uplot_licence_begin,
          web_uplot_licence_end },
    };

    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++)
        if (strcmp(files[i].name, name) == 0)
            return &files[i];
    return NULL;
}
