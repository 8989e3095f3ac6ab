/* args.c - see args.h */
#include "args.h"
#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"
#include "base/utf8.h"
#include "option.h"

static const struct row {
    const char *name;      /* long form, without the dashes */
    char letter;           /* short form, 0: none */
    enum { FLAG, TEXT, NUMBER, WHOLE, OPTION } type;
    size_t at;             /* where in struct args */
    double low, high;
    unsigned group;
    const char *value, *help;
} rows[] = {
    { "server", 's', TEXT, offsetof(struct args, server), 0, 0, TAKES_ALWAYS, "ENDPOINT",
      "the daemon (default $MODALD_URL, else /run/modald, else $XDG_RUNTIME_DIR/modald)" },
    { "local", 0, FLAG, offsetof(struct args, local), 0, 0, TAKES_ALWAYS, "",
      "run in this process, without a daemon" },
    { "json", 'j', FLAG, offsetof(struct args, json), 0, 0, TAKES_ALWAYS, "",
      "one JSON document on stdout, errors included" },
    { "keyfile", 0, TEXT, offsetof(struct args, keyfile), 0, 0, TAKES_ALWAYS, "FILE",
      "CURVE keys (default $MODALD_KEYFILE)" },
    { "help", 'h', FLAG, offsetof(struct args, help), 0, 0, TAKES_ALWAYS, "",
      "say what a verb takes" },
    { "version", 'V', FLAG, offsetof(struct args, version), 0, 0, TAKES_ALWAYS, "",
      "print the version" },
    { "option", 'o', OPTION, 0, 0, 0, TAKES_OPTIONS, "KEY=VALUE",
      "an option of the job; numbers, words, true, false, lists a,b" },
    { "dt", 0, NUMBER, offsetof(struct args, dt), 1e-300, 1e300, TAKES_SIGNALS, "SECONDS",
      "time between samples, for files that do not say" },
    { "dataset", 0, TEXT, offsetof(struct args, dataset), 0, 0, TAKES_SIGNALS, "PATH",
      "the array that is the signals, in files that have several" },
    { "ignore-time", 0, FLAG,   offsetof(struct args, ignore_time), 0, 0,    TAKES_SIGNALS, "",
      "rows are --dt apart, whatever the file says of time" },
    { "scale", 0, NUMBER, offsetof(struct args, scale), 1e-300, 1e300, TAKES_SIGNALS, "FACTOR",
      "every sample times this (sound files are -1 .. 1)" },
    { "sweep", 0, TEXT, offsetof(struct args, sweep), 0, 0, TAKES_CURVE, "PATH=A:B:N",
      "solve at N points from A to B" },
    { "continue", 0, TEXT, offsetof(struct args, follow), 0, 0, TAKES_CURVE, "PATH=A:B",
      "follow the curve from A to B around folds" },
    { "output",    'O', TEXT,   offsetof(struct args, output),    0, 0,      TAKES_OUTPUT,  "FILE",
      "where signals, spectra and waveforms go: .h5 or .csv" },
    { "plot",      0,   TEXT,   offsetof(struct args, plot),      0, 0,      TAKES_PLOT,
      "FILE.svg", "draw the result; - for stdout" },
    { "csv", 0, FLAG, offsetof(struct args, csv), 0, 0, TAKES_CSV, "",
      "the table of modes, or of a sweep's points, as CSV on stdout" },
    { "prometheus", 0, TEXT, offsetof(struct args, prometheus), 0, 0, TAKES_LIVE, "FILE.prom",
      "the last window's modes as gauges, for the node exporter" },
    { "key", 'k', TEXT, offsetof(struct args, key), 0, 0, TAKES_SUBMIT | TAKES_QUEUE, "KEY",
      "your name for the submission: the same key is the same job; list: keys that begin so" },
    { "priority", 'p', WHOLE, offsetof(struct args, priority), 0, 255, TAKES_SUBMIT, "0-255",
      "higher is more urgent (default 100)" },
    { "run-limit", 0, NUMBER, offsetof(struct args, run_limit), 1e-3, 1e9,
      TAKES_SUBMIT | TAKES_SBATCH, "SECONDS", "bound of one attempt" },
    { "deadline", 0, NUMBER, offsetof(struct args, deadline), 1e-3, 1e9, TAKES_SUBMIT, "SECONDS",
      "bound of everything from submission on" },
    { "wait", 'w', FLAG, offsetof(struct args, wait), 0, 0, TAKES_WAIT, "",
      "until the job has ended" },
    { "cancel", 0, FLAG, offsetof(struct args, cancel), 0, 0, TAKES_SWEEP, "",
      "end its jobs instead" },
    { "timeout", 't', NUMBER, offsetof(struct args, timeout), 0, 1e9, TAKES_TIMEOUT, "SECONDS",
      "wait no longer; exit 5 if not finished" },
    { "state", 0, TEXT, offsetof(struct args, state), 0, 0, TAKES_LIST, "STATE",
      "only queued, running, done, failed, cancelled or dead" },
    { "kind", 0, TEXT, offsetof(struct args, kind), 0, 0, TAKES_LIST, "KIND",
      "only jobs of this kind" },
    { "limit", 'n', WHOLE, offsetof(struct args, limit), 1, 1000, TAKES_LIST | TAKES_PAGE,
      "N", "at most N of them" },
    { "after", 0, TEXT, offsetof(struct args, after), 0, 0, TAKES_LIST | TAKES_PAGE, "CURSOR",
      "go on from `next` of the page before" },
    { "newest", 0, FLAG, offsetof(struct args, newest), 0, 0, TAKES_QUEUE, "",
      "the newest first" },
    { "user", 0, TEXT, offsetof(struct args, user), 0, 0, TAKES_QUEUE | TAKES_PAGE | TAKES_USER,
      "USER", "those of another (admin)" },
    { "since", 0, TEXT, offsetof(struct args, since), 0, 0, TAKES_QUEUE, "AGE|UTC",
      "submitted in the last AGE (90s, 30m, 12h, 7d), or from a date on: 2026-11-22[T09:30]" },
    { "from", 0, TEXT, offsetof(struct args, from), 0, 0, TAKES_BULK | TAKES_FROM,
      "LIST.jsonl", "one submission a line" },
    { "resume", 0, FLAG, offsetof(struct args, resume), 0, 0, TAKES_BULK, "",
      "skip what was accepted before" },
    { "sbatch", 0, TEXT, offsetof(struct args, sbatch), 0, 0, TAKES_SBATCH, "DIR",
      "write an array job of Slurm's into DIR instead; `gather DIR` has its results" },
    { "array", 0, WHOLE, offsetof(struct args, array), 1, 4e6, TAKES_SBATCH, "N",
      "its elements at most (default 1000, what Slurm takes where MaxArraySize is not set)" },
    { "window", 0, WHOLE, offsetof(struct args, window), 1, 1e9, TAKES_BULK | TAKES_PUSH, "N",
      "submit: submissions in flight (default 256); stream: samples of a live window" },
    { "hop", 0, WHOLE, offsetof(struct args, hop), 1, 1e9, TAKES_PUSH, "N",
      "samples between two live windows (default half a window)" },
    { "data", 'd', TEXT, offsetof(struct args, data), 0, 0, TAKES_DATA, "DIR",
      "a daemon's data folder on this machine" },
    { "name", 0, TEXT, offsetof(struct args, name), 0, 0, TAKES_STREAM, "NAME",
      "the stream's name (default the file's)" },
    { "rate", 0, NUMBER, offsetof(struct args, rate), 0, 1e9, TAKES_PUSH, "N",
      "push N samples a second (default: as fast as they go)" },
};
enum {
    ROWS = sizeof rows / sizeof rows[0],
    NAME_ROOM = 64                   /* of a name with its dashes; longer ones are none of ours */
};

static const struct row *find(const char *name, size_t length)
{
    for (int i = 0; i < ROWS; i++)
        if (strlen(rows[i].name) == length && strncmp(rows[i].name, name, length) == 0)
            return &rows[i];
    return NULL;
}

static const struct row *find_letter(char letter)
{
    for (int i = 0; i < ROWS; i++)
        if (letter != 0 && rows[i].letter == letter)
            return &rows[i];
    return NULL;
}

static enum modal_status set_number(const struct row *row, const char *text, double *at,
                                    struct modal_error *err)
{
    char *end;
    double value;

    errno = 0;
    value = strtod(text, &end);
    if (end == text || *end != 0 || !isfinite(value) || value < row->low || value > row->high
        || (row->type == WHOLE && value != floor(value)))
        return modal_fail_field(err, MODAL_BAD_INPUT, row->name,
                                "--%s is \"%.60s\"; accepted: %s, a %snumber from %g to %g",
                                row->name, text, row->value, row->type == WHOLE ? "whole " : "",
                                row->low, row->high);
    *at = value;
    return MODAL_OK;
}

static enum modal_status set(const struct row *row, const char *text, struct args *args,
                             struct modal_error *err)
{
    char *at = (char *)args + row->at;

    switch (row->type) {
    case FLAG:   *(bool *)at = true; return MODAL_OK;
    case TEXT:
        /* files may have any name */
        if ((row->group & (TAKES_SUBMIT | TAKES_LIST | TAKES_QUEUE | TAKES_STREAM
                           | TAKES_CURVE)) != 0
            && !utf8_valid(text))
            return modal_fail_field(err, MODAL_BAD_INPUT, row->name, "--%s is not UTF-8",
                                    row->name);
        *(const char **)at = text;
        return MODAL_OK;
    case OPTION: return option_add(args->options, text, err);
    case NUMBER:
    case WHOLE:  return set_number(row, text, (double *)at, err);
    }
    return MODAL_INTERNAL;
}

static enum modal_status no_option(const char *word, struct modal_error *err)
{
    char dashed[ROWS][NAME_ROOM], only[NAME_ROOM], meant[NEAR_TEXT];
    const char *names[ROWS + 1];

    for (int i = 0; i < ROWS; i++) {
        snprintf(dashed[i], NAME_ROOM, "--%s", rows[i].name);
        names[i] = dashed[i];
    }
    names[ROWS] = NULL;
    snprintf(only, sizeof only, "%.*s", (int)strcspn(word, "="), word);
    near_text(only, names, meant);
    return modal_fail_field(err, MODAL_BAD_INPUT, only, "no option %s%s; `modalctl --help` and "
                            "`modalctl VERB --help` list them", only, meant);
}

/* `--name=value`, `--name value`, `-x value`, `-xvalue`; *I moves past what was used. */
static enum modal_status read_option(int argc, const char *const *argv, int *i, struct args *args,
                                     struct modal_error *err)
{
    const char *word = argv[*i], *value = NULL;
    bool is_long = word[1] == '-';
    size_t length = is_long ? strcspn(word + 2, "=") : 1;
    const struct row *row = is_long ? find(word + 2, length) : find_letter(word[1]);

    if (row == NULL)
        return no_option(word, err);
    if (is_long && word[2 + length] == '=')
        value = word + 3 + length;
    else if (!is_long && word[2] != 0)
        value = word + 2;
    if (row->type == FLAG && value != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, row->name, "--%s takes no value", row->name);
    if (row->type != FLAG && value == NULL) {
        if (*i + 1 >= argc)
            return modal_fail_field(err, MODAL_BAD_INPUT, row->name, "--%s needs %s", row->name,
                                    row->value);
        value = argv[++*i];
    }
    enum modal_status rc = set(row, value, args, err);
    if (row->type == OPTION)
        while (rc == MODAL_OK && *i + 1 < argc && option_looks_like(argv[*i + 1]))
            rc = option_add(args->options, argv[++*i], err);
    return rc;
}

static enum modal_status add_curve(struct args *args, struct modal_error *err)
{
    if (args->sweep != NULL && args->follow != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "continue",
                                "--sweep and --continue exclude each other");
    if (args->sweep != NULL)
        return option_set_text(args->options, "sweep", args->sweep, err);
    return args->follow != NULL ? option_set_text(args->options, "continue", args->follow, err)
                                : MODAL_OK;
}

enum modal_status args_read(int argc, const char *const *argv, struct args *args,
                            struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    bool only_words = false;

    *args = (struct args) { .timeout = -1, .priority = -1, .options = cJSON_CreateObject() };
    for (int i = 1; i < argc; i++)
        args->json |= strcmp(argv[i], "--json") == 0 || strcmp(argv[i], "-j") == 0;
    if (args->options == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for the command line");
    for (int i = 1; i < argc && rc == MODAL_OK; i++) {
        if (!only_words && strcmp(argv[i], "--") == 0)
            only_words = true;
        else if (!only_words && argv[i][0] == '-' && argv[i][1] != 0)
            rc = read_option(argc, argv, &i, args, err);
        else if (args->words == ARGS_WORDS_MOST)
            rc = modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "more than %d arguments",
                                  ARGS_WORDS_MOST);
        else
            args->word[args->words++] = argv[i];
    }
    return rc == MODAL_OK ? add_curve(args, err) : rc;
}

void args_done(struct args *args)
{
    cJSON_Delete(args->options);
    args->options = NULL;
}

/* Was the option given?  An option not given keeps what args_read set. */
static bool given(const struct args *args, const struct row *row)
{
    const char *at = (const char *)args + row->at;

    switch (row->type) {
    case FLAG:   return *(const bool *)at;
    case TEXT:   return *(const char *const *)at != NULL;
    case OPTION: return args->options->child != NULL && args->sweep == NULL && args->follow == NULL;
    case NUMBER:
    case WHOLE:
        return row->at == offsetof(struct args, timeout)
                       || row->at == offsetof(struct args, priority)
                   ? *(const double *)at >= 0
                   : *(const double *)at != 0;
    }
    return false;
}

enum modal_status args_check(const struct args *args, const char *verb, unsigned takes,
                             struct modal_error *err)
{
    char list[512] = "";

    for (int i = 0; i < ROWS; i++) {
        if ((rows[i].group & (takes | TAKES_ALWAYS)) != 0 || !given(args, &rows[i]))
            continue;
        for (int j = 0; j < ROWS; j++)
            if ((rows[j].group & takes) != 0)
                snprintf(list + strlen(list), sizeof list - strlen(list), " --%s", rows[j].name);
        return modal_fail_field(err, MODAL_BAD_INPUT, rows[i].name, "%s takes no --%s; accepted:%s",
                                verb, rows[i].name,
                                list[0] ? list : " nothing but the common options");
    }
    return MODAL_OK;
}

void args_help(FILE *to, unsigned takes)
{
    for (int i = 0; i < ROWS; i++) {
        char left[48], shortened[8] = "    ";

        if ((rows[i].group & takes) == 0)
            continue;
        if (rows[i].letter)
            snprintf(shortened, sizeof shortened, "-%c, ", rows[i].letter);
        snprintf(left, sizeof left, "%s--%s %s", shortened, rows[i].name, rows[i].value);
        fprintf(to, "  %-28s %s\n", left, rows[i].help);
    }
}
