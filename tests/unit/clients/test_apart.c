/* test_apart.c - what becomes of us when reading a file in a child does not come to its end */
#include "check.h"
#include <signal.h>
#include <stdlib.h>
#include <sys/resource.h>
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
    apart_allow((double)((struct context *)context)->bytes, 0);
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

TEST(a_child_that_breaks_down_is_a_damaged_file)
{
    static const int signals[] = { SIGSEGV, SIGBUS, SIGFPE, SIGABRT, SIGILL };

    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        struct context c = { .by = signals[i] };
        struct modal_error err = { 0 };

        CHECK(run(end_by_signal, &c, &err) == MODAL_BAD_INPUT);
        CHECK_STRING(err.field, "file");
        CHECK(strstr(err.message, "x.h5") != NULL && strstr(err.message, "damaged") != NULL);
    }
}

TEST(a_child_that_somebody_or_a_limit_ends_is_no_damaged_file)
{
    static const struct { int by; enum modal_status rc; } ends[] = {
        { SIGTERM, MODAL_IO }, { SIGINT, MODAL_IO }, { SIGKILL, MODAL_NO_MEMORY },
        { SIGXCPU, MODAL_BAD_INPUT },
    };

    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        struct context c = { .by = ends[i].by };
        struct modal_error err = { 0 };

        CHECK(run(end_by_signal, &c, &err) == ends[i].rc);
        CHECK_STRING(err.field, "file");
        CHECK(strstr(err.message, "x.h5") != NULL && strstr(err.message, "damaged") == NULL);
    }
}

/* More than a pipe holds: the child tells on when nobody hears. */
static bool tell_much(void *context, FILE *to)
{
    static const char much[1 << 20];

    (void)context;
    return fwrite(much, 1, sizeof much, to) == sizeof much;
}

static bool hear_nothing(void *context, FILE *from)
{
    (void)context;
    return fgetc(from) == EOF;
}

TEST(what_we_have_no_memory_to_hear_is_no_damaged_file)
{
    const struct apart little = { take, tell, hear_nothing }, much = { take, tell_much,
                                                                       hear_nothing };
    struct context c = { .bytes = 100 };

    for (int i = 0; i < 3; i++) {                 /* a child that SIGPIPE ends, and one not */
        struct modal_error err = { 0 };

        signal(SIGPIPE, i < 2 ? SIG_DFL : SIG_IGN);
        CHECK(apart_do(i > 0 ? &much : &little, &c, "x.h5", "file", &err) == MODAL_NO_MEMORY);
        CHECK(strstr(err.message, "x.h5") != NULL && strstr(err.message, "damaged") == NULL);
    }
    signal(SIGPIPE, SIG_DFL);
}

static void do_nothing(int number)
{
    (void)number;
}

/* Often enough that the parent waits for what is told when one of them reaches it. */
static enum modal_status signal_to_the_parent(void *context, struct modal_error *err)
{
    for (int i = 0; i < 30; i++) {
        usleep(1000);
        kill(getppid(), SIGWINCH);
    }
    return take(context, err);
}

TEST(a_signal_that_we_catch_does_not_end_what_we_hear)
{
    const struct sigaction caught = { .sa_handler = do_nothing };
    struct context c = { .bytes = 1000 };

    sigaction(SIGWINCH, &caught, NULL);
    CHECK(run(signal_to_the_parent, &c, NULL) == MODAL_OK && c.told == 1);
    signal(SIGWINCH, SIG_DFL);
}

/* Seconds that the child has for as many pieces as CONTEXT has bytes. */
static enum modal_status say_time(void *context, struct modal_error *err)
{
    struct context *c = context;
    struct rlimit limit;

    (void)err;
    apart_allow(0, (double)c->bytes);
    getrlimit(RLIMIT_CPU, &limit);
    c->told = (double)limit.rlim_cur;
    return MODAL_OK;
}

TEST(a_child_has_time_for_each_piece)
{
    struct context none = { 0 }, many = { .bytes = 1000000 };

    CHECK(run(say_time, &none, NULL) == MODAL_OK && run(say_time, &many, NULL) == MODAL_OK);
    CHECK(none.told < 10 && many.told >= none.told + 11);   /* they took 11 us each */
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
