/* result_table.c - see result_table.h */
#include "result_table.h"
#include <string.h>
#include "ctl/field.h"

enum { HEAD_MOST = 96 };                 /* bytes of a column's name: two keys */

/* A column: a member of a row, or of an object in it. */
struct column { const char *outer, *inner; };

static bool is_plain(const cJSON *item)
{
    return !cJSON_IsObject(item) && !(cJSON_IsArray(item) && item->child != NULL
                                      && (cJSON_IsObject(item->child)
                                          || cJSON_IsArray(item->child)));
}

static void show_plain(struct html *html, const cJSON *item)
{
    const cJSON *entry;
    int count = 0;

    if (cJSON_IsNumber(item))
        html_number(html, item->valuedouble);
    else if (cJSON_IsString(item))
        html_text(html, item->valuestring);
    else if (cJSON_IsBool(item))
        html_raw(html, cJSON_IsTrue(item) ? "yes" : "no");
    else if (cJSON_IsArray(item)) {
        cJSON_ArrayForEach(entry, item) {
            if (count++ == TABLE_NUMBERS)
                break;
            html_raw(html, count > 1 ? ", " : "");
            if (!cJSON_IsArray(entry) && !cJSON_IsObject(entry))
                show_plain(html, entry);
        }
        if (entry != NULL)
            html_format(html, ", ... (%d)", cJSON_GetArraySize(item));
    } else if (item != NULL)
        html_raw(html, "-");
}

static int add_column(struct column columns[TABLE_COLUMNS], int count, const char *outer,
                      const char *inner)
{
    if (count < TABLE_COLUMNS)
        columns[count++] = (struct column) { outer, inner };
    return count;
}

/* The columns of a table by its first row: plain members, each with its standard error behind it,
 * then those of objects in the row. */
static int find_columns(const cJSON *row, struct column columns[TABLE_COLUMNS])
{
    const cJSON *outer, *inner, *std = field_get(row, "std");
    int count = 0;

    cJSON_ArrayForEach(outer, row) {
        if (!is_plain(outer) || outer->string == NULL)
            continue;
        count = add_column(columns, count, outer->string, NULL);
        if (field_get(std, outer->string) != NULL)
            count = add_column(columns, count, "std", outer->string);
    }
    cJSON_ArrayForEach(outer, row)
        if (cJSON_IsObject(outer) && outer != std)
            cJSON_ArrayForEach(inner, outer)
                if (is_plain(inner))
                    count = add_column(columns, count, outer->string, inner->string);
    return count;
}

static void show_rows(struct html *html, const char *name, const cJSON *rows)
{
    struct column columns[TABLE_COLUMNS];
    char texts[TABLE_COLUMNS][HEAD_MOST];
    const char *heads[TABLE_COLUMNS + 1] = { NULL };
    int count = find_columns(rows->child, columns), shown = 0;
    const cJSON *row;

    for (int i = 0; i < count; i++) {
        snprintf(texts[i], HEAD_MOST, "%.40s%s%.40s", columns[i].outer,
                 columns[i].inner != NULL ? "." : "", columns[i].inner ? columns[i].inner : "");
        heads[i] = texts[i];
    }
    html_table(html, name, heads);
    cJSON_ArrayForEach(row, rows) {
        if (shown++ == TABLE_ROWS)
            break;
        html_raw(html, "<tr>");
        for (int i = 0; i < count; i++) {
            const cJSON *cell = field_get(row, columns[i].outer);
            html_raw(html, "<td>");
            show_plain(html, columns[i].inner != NULL ? field_get(cell, columns[i].inner) : cell);
            html_raw(html, "</td>");
        }
        html_raw(html, "</tr>\n");
    }
    html_table_end(html);
    if (row != NULL)
        html_format(html, "%d of %d are shown.", TABLE_ROWS, cJSON_GetArraySize(rows));
}

/* Pairs of numbers, such as multipliers, or other lists of lists. */
static void show_lists(struct html *html, const cJSON *lists)
{
    const cJSON *list;
    int shown = 0;

    html_raw(html, "<ol start=\"0\" class=\"lists\">");
    cJSON_ArrayForEach(list, lists) {
        if (shown++ == TABLE_ROWS)
            break;
        html_raw(html, "<li>");
        show_plain(html, list);
        html_raw(html, "</li>");
    }
    html_raw(html, "</ol>\n");
    if (list != NULL)
        html_format(html, "%d of %d are shown.", TABLE_ROWS, cJSON_GetArraySize(lists));
}

static void show_pairs(struct html *html, const cJSON *object)
{
    const cJSON *item;
    int shown = 0;

    html_raw(html, "<dl class=\"facts\">");
    cJSON_ArrayForEach(item, object)
        if (is_plain(item) && shown++ < TABLE_ROWS) {
            html_raw(html, "<dt>");
            html_text(html, item->string != NULL ? item->string : "");
            html_raw(html, "</dt><dd>");
            show_plain(html, item);
            html_raw(html, "</dd>");
        }
    html_raw(html, "</dl>\n");
}

static void show_member(struct html *html, const cJSON *item, int depth)
{
    const char *name = item->string != NULL ? item->string : "";
    const cJSON *inner;

    if (item->child == NULL || depth == TABLE_DEPTH)
        return;
    fprintf(html->file, "<h%d>", depth + 2);
    html_text(html, name);
    fprintf(html->file, "</h%d>\n", depth + 2);
    if (cJSON_IsArray(item) && cJSON_IsObject(item->child))
        show_rows(html, name, item);
    else if (cJSON_IsArray(item))
        show_lists(html, item);
    else {
        show_pairs(html, item);
        cJSON_ArrayForEach(inner, item)
            if (!is_plain(inner))
                show_member(html, inner, depth + 1);
    }
}

void result_table(struct html *html, const cJSON *document)
{
    static const char *const first[] = {
        "modes", "stability", "diagnostics", "rungs", "points", "multipliers", "exponents",
        "effects", "reconstruction", "cost", NULL };
    const cJSON *item;

    show_pairs(html, document);
    for (int i = 0; first[i] != NULL; i++)
        if ((item = field_get(document, first[i])) != NULL && !is_plain(item))
            show_member(html, item, 1);
    cJSON_ArrayForEach(item, document) {
        int i = 0;
        while (first[i] != NULL && item->string != NULL && strcmp(first[i], item->string) != 0)
            i++;
        if (first[i] == NULL && !is_plain(item))
            show_member(html, item, 1);
    }
}
