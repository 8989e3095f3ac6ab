/* result_table.h - a document of any kind as tables: lists of objects a row each, what is single
 * as pairs; as much as a page holds */
#ifndef WEB_RESULT_TABLE_H
#define WEB_RESULT_TABLE_H
#include "base/json.h"
#include "html.h"

enum {
    TABLE_ROWS = 200,            /* of a table, ... */
    TABLE_COLUMNS = 16,          /* ... and what a screen takes without the hand */
    TABLE_NUMBERS = 32,          /* of a list in a cell */
    TABLE_DEPTH = 4,             /* of objects in objects */
};

/* The members of DOCUMENT under headings of their names, those first that people look for. */
void result_table(struct html *html, const cJSON *document);
#endif
