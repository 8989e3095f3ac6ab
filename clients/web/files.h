/* files.h - the page's own files: style, script, the picture library; built in */
#ifndef WEB_FILES_H
#define WEB_FILES_H
#include <stddef.h>

struct file { const char *name, *type, *text, *end; };

/* NULL: there is none of this name. */
const struct file *file_find(const char *name);
#endif
