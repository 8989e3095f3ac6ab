/* result_help.c - see result_help.h */
#include "result_help.h"
#include <stdbool.h>
#include <string.h>
#include "base/near.h"
#include "job/result_key.h"

enum { WORDS_MOST = 512 };           /* kinds, members and codes: three times what there is */

static void print_as(FILE *to, const struct result_key *key)
{
    for (int i = 0; key->as[i] != NULL; i++)
        fprintf(to, "%s%s", i > 0 ? ", " : "; may have the members of ", key->as[i]);
}

static void print_keys(FILE *to, const struct result_key *keys, int indent);

static void print_key(FILE *to, const struct result_key *key, int indent)
{
    static const char *const types[] = {
        [RESULT_NUMBER] = "a number", [RESULT_WHOLE] = "a whole number",
        [RESULT_TRUTH] = "true or false", [RESULT_TEXT] = "text", [RESULT_COMPLEX] = "[re, im]",
        [RESULT_SPAN] = "[t0, t1]",
        [RESULT_OBJECT] = "an object", [RESULT_OWN] = "a form of its own",
    };

    fprintf(to, "%*s%s: %s\n%*s%s", indent, "", key->name, key->means, indent + 8, "",
            types[key->type]);
    if (key->unit != NULL)
        fprintf(to, ", %s", key->unit);
    if (key->list != NULL)
        fprintf(to, "; a list, %s", key->list);
    print_as(to, key);
    if (key->null != NULL)
        fprintf(to, "; null: %s", key->null);
    if (key->absent != NULL)
        fprintf(to, "; absent: %s", key->absent);
    fputc('\n', to);
    print_keys(to, key->members, indent + 4);
}

static void print_keys(FILE *to, const struct result_key *keys, int indent)
{
    for (; keys != NULL && keys->name != NULL; keys++)
        print_key(to, keys, indent);
}

/* Each member called WORD among KEYS and theirs, below its path. */
static int print_found(FILE *to, const struct result_key *keys, const char *path, const char *word)
{
    char here[256];
    int found = 0;

    for (; keys != NULL && keys->name != NULL; keys++) {
        snprintf(here, sizeof here, "%s.%s%s", path, keys->name, keys->list != NULL ? "[]" : "");
        if (strcmp(keys->name, word) == 0) {
            fprintf(to, "%s\n", here);
            print_key(to, keys, 4);
            fputc('\n', to);
            found++;
        } else
            found += print_found(to, keys->members, here, word);
    }
    return found;
}

static void print_code(FILE *to, const struct result_code *code)
{
    fprintf(to, "    %s: %s\n            of %s; %s\n", code->code, code->means, code->kind,
            code->advice);
}

static int add_names(const struct result_key *keys, const char **names, int count)
{
    for (; keys != NULL && keys->name != NULL && count < WORDS_MOST; keys++) {
        names[count] = keys->name;
        count = add_names(keys->members, names, count + 1);
    }
    return count;
}

/* Each word once, as many members have the same name. */
static void drop_repeated(const char **names, int count)
{
    int kept = 0;

    for (int i = 0; i < count; i++) {
        bool seen = false;
        for (int j = 0; j < kept && !seen; j++)
            seen = strcmp(names[i], names[j]) == 0;
        if (!seen)
            names[kept++] = names[i];
    }
    names[kept] = NULL;
}

static enum modal_status no_word(const char *word, struct modal_error *err)
{
    const char *names[WORDS_MOST + 1];
    char meant[NEAR_TEXT];
    int count = 0;

    for (const struct result_document *d = result_documents; d->kind != NULL; d++) {
        if (count < WORDS_MOST)
            names[count++] = d->kind;
        count = add_names(d->keys, names, count);
    }
    for (const struct result_code *c = result_codes; c->code != NULL && count < WORDS_MOST; c++)
        names[count++] = c->code;
    drop_repeated(names, count);
    near_text(word, names, meant);
    return modal_fail_field(err, MODAL_BAD_INPUT, "member", "no result has a member \"%.40s\"%s; "
                            "accepted: a kind, a member or a diagnostic code, as "
                            "`modalctl help result` lists them", word, meant);
}

static void print_document(FILE *to, const struct result_document *d)
{
    fprintf(to, "%s\n  %s\n", d->kind, d->means);
    print_keys(to, d->keys, 4);
    fputc('\n', to);
}

enum modal_status result_help(FILE *to, const char *word, struct modal_error *err)
{
    int found = 0;

    for (const struct result_document *d = result_documents; d->kind != NULL; d++)
        if (word == NULL || strcmp(d->kind, word) == 0) {
            print_document(to, d);
            found++;
        } else
            found += print_found(to, d->keys, d->kind, word);
    if (word == NULL)
        fputs("diagnostics\n  codes, and what to do\n", to);
    for (const struct result_code *c = result_codes; c->code != NULL; c++)
        if (word == NULL || strcmp(c->code, word) == 0) {
            print_code(to, c);
            found++;
        }
    return found > 0 ? MODAL_OK : no_word(word, err);
}
