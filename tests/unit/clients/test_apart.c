/* test_apart.c - what becomes of us when reading a file in a child does not come to its end */
#include "check.h"
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>
#include "ctl/apart.h"
#include "base/sanitized.h"

struct context { int by; double told; size_t bytes; };

static enum modal_status end_by_signal(void *context, struct modal_error *err)
{
    (void)err;
    signal(((struct context *)context)->by, SIG_DFL);       /* a sanitizer has its own */
    raise(((struct context *)context)->by);
    return MODAL_OK;
}

static enum modal_status end_early(void *context, struct modal_error *err)
{
    (void)context;
    (void)err;
    _exit(0);
}

static enum modal_status refuse(void *context, struct modal_error *err)
{
    (void)context;
    return modal_fail_field(err, MODAL_TOO_LARGE, "one", "as asked");
}

static enum modal_status take(void *context, struct modal_error *err)
{
    struct context *c = context;
    char *bytes = malloc(c->bytes);

    if (bytes == NULL)
        return modal_fail_field(err, MODAL_NO_MEMORY, "bytes", "none");
    memset(bytes, 1, c->bytes);
    c->told = bytes[c->bytes / 2];
    free(bytes);
    return MODAL_OK;
}

static enum modal_status take_what_is_allowed(void *context, struct modal_error *err)
{
    apart_allow((double)((struct context *)context)->bytes);
    return take(context, err);
}

static bool tell(void *context, FILE *to)
{
    const struct context *c = context;

    return fwrite(&c->told, sizeof c->told, 1, to) == 1 && apart_tell_text("what", to)
           && apart_tell_text(NULL, to);
}

static bool tell_half(void *context, FILE *to)
{
    (void)context;
    return fwrite("x", 1, 1, to) == 1;
}

static bool hear(void *context, FILE *from)
{
    struct context *c = context;
    char *what = NULL, *none = NULL;
    bool ok = fread(&c->told, sizeof c->told, 1, from) == 1 && apart_hear_text(&what, from)
              && apart_hear_text(&none, from) && strcmp(what, "what") == 0 && none == NULL;

    free(what);
    return ok;
}

static enum modal_status run(enum modal_status (*work)(void *, struct modal_error *),
                             struct context *c, struct modal_error *err)
{
    const struct apart how = { work, tell, hear };

    return apart_do(&how, c, "x.h5", "file", err);
}

TEST(a_child_that_ends_by_a_signal_is_a_damaged_file)
{
    static const int signals[] = { SIGSEGV, SIGBUS, SIGFPE, SIGABRT, SIGXCPU };

    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        struct context c = { .by = signals[i] };
        struct modal_error err = { 0 };

        CHECK(run(end_by_signal, &c, &err) == MODAL_BAD_INPUT);
        CHECK_STRING(err.field, "file");
        CHECK(strstr(err.message, "x.h5") != NULL && strstr(err.message, "damaged") != NULL);
    }
}

TEST(a_child_that_tells_less_than_all_is_a_damaged_file)
{
    const struct apart half = { take, tell_half, hear };
    struct context c = { .bytes = 100 };
    struct modal_error err = { 0 };

    CHECK(run(end_early, &c, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "file");
    CHECK(apart_do(&half, &c, "x.h5", "file", NULL) == MODAL_BAD_INPUT);
}

TEST(what_a_child_refuses_is_refused_in_its_words)
{
    struct context c = { 0 };
    struct modal_error err = { 0 };

    CHECK(run(refuse, &c, &err) == MODAL_TOO_LARGE);
    CHECK_STRING(err.field, "one");
    CHECK_STRING(err.message, "as asked");
}

TEST(what_a_child_finds_is_told)
{
    struct context c = { .bytes = 1000 };

    CHECK(run(take, &c, NULL) == MODAL_OK && c.told == 1);
}

TEST(a_child_has_the_memory_that_it_says_it_takes_and_no_more)
{
    struct context c = { .bytes = (size_t)300 << 20 };
    struct modal_error err = { 0 };

    if (SANITIZED)                        /* without limits of memory */
        return;
    CHECK(run(take, &c, &err) == MODAL_NO_MEMORY);
    CHECK_STRING(err.field, "bytes");
    CHECK(run(take_what_is_allowed, &c, NULL) == MODAL_OK && c.told == 1);
}
