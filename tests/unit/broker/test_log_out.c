/* test_log_out.c - who does not read the log is not waited for */
#include "check.h"
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>
#include "broker/shell/log_out.h"

static int own, reader;

/* stderr is a pipe that READER reads, not waiting either. */
static void start(void)
{
    int ends[2];

    own = dup(STDERR_FILENO);
    CHECK(pipe2(ends, O_CLOEXEC) == 0);
    dup2(ends[1], STDERR_FILENO);
    close(ends[1]);
    reader = ends[0];
    fcntl(reader, F_SETFL, O_NONBLOCK);
    log_out_begin();
}

static void stop(void)
{
    dup2(own, STDERR_FILENO);
    close(own);
    close(reader);
}

/* The lines that wait in the pipe. */
static int lines(void)
{
    static char text[1 << 18];
    ssize_t length = read(reader, text, sizeof text);
    int count = 0;

    for (ssize_t i = 0; i < length; i++)
        count += text[i] == '\n';
    return count;
}

TEST(each_line_is_read_or_counted_whole_and_in_order)
{
    enum { LINES = 4000 };
    unsigned long dropped = 0;
    char text[100];
    int seen = 0;

    start();
    for (int i = 0; i < LINES; i++) {
        snprintf(text, sizeof text, "n=%080d", i);
        log_out_put("time=0 ", text);
        dropped += log_out_flush();
    }
    CHECK(dropped == 0 && log_out_waits());        /* nothing is told before what came before */
    for (int i = 0; i < 8 && dropped == 0; i++) {
        seen += lines();
        dropped = log_out_flush();
    }
    seen += lines();
    CHECK(dropped > 0 && dropped + (unsigned long)seen == LINES);
    log_out_put("", "next");
    CHECK(log_out_flush() == 0 && !log_out_waits() && lines() == 1);
    stop();
}

/* On the code of before each line that told of dropped ones was itself dropped, and told, for ever.
 */
TEST(what_a_full_disk_refuses_is_counted_and_told_with_the_first_that_it_takes)
{
    int pipe_end, full;

    start();
    pipe_end = dup(STDERR_FILENO);
    full = open("/dev/full", O_WRONLY | O_CLOEXEC);
    CHECK(full >= 0 && dup2(full, STDERR_FILENO) == STDERR_FILENO);
    close(full);
    for (int i = 0; i < 10; i++) {
        log_out_put("", "refused");
        CHECK(log_out_flush() == 0 && log_out_flush() == 0);
    }
    dup2(pipe_end, STDERR_FILENO);
    close(pipe_end);
    log_out_put("", "taken");
    CHECK(log_out_flush() == 10 && lines() == 1);
    stop();
}

TEST(a_pipe_whose_reader_is_gone_is_not_waited_for)
{
    start();
    signal(SIGPIPE, SIG_IGN);
    close(reader);
    reader = -1;
    for (int i = 0; i < 10; i++) {
        log_out_put("", "nobody");
        log_out_flush();
    }
    CHECK(!log_out_waits());
    log_out_end();
    stop();
}
