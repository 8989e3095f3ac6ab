/*
 * hosts.c - simulations that live dangerously, with the three calls in them
 *
 *     hosts HABIT STEPS [SECONDS]
 *
 * One run writes its states to stdout and has an exit status of its own, 7; both must be the same
 * with $MODALD_URL and without, whatever is at the other end.  Each HABIT is something that real
 * hosts do to their process behind a library's back; the table at the end names them.  SECONDS of
 * real time pass with each step.
 */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>
#include "../../clients/c/modald_stream.h"

enum { CHANNELS = 2, STATUS = 7 };

static long steps = 2000;
static struct timespec pace;
static volatile sig_atomic_t heard;

/* A decaying rotation; what the host computes. */
static void state(long i, double *y)
{
    y[0] = exp(-1e-3 * (double)i) * cos(0.1 * (double)i);
    y[1] = exp(-1e-3 * (double)i) * sin(0.1 * (double)i);
}

/* Steps FROM to TO of the run: pushed to S, told to OUT. */
static void run(modald_stream *s, long from, long to, FILE *out)
{
    double y[CHANNELS];

    for (long i = from; i < to; i++) {
        state(i, y);
        modald_push(s, y);
        fwrite(y, sizeof *y, CHANNELS, out);
        if (pace.tv_sec > 0 || pace.tv_nsec > 0)
            nanosleep(&pace, NULL);
    }
}

static modald_stream *begin(const char *name)
{
    return modald_open(name, CHANNELS, 1e-3);
}

/* ------------------------------------------------------------------ habits */

static void plain(void)
{
    modald_stream *s = begin("plain");

    run(s, 0, steps, stdout);
    modald_close(s);
}

static void exits_without_close(void)
{
    run(begin("left"), 0, steps, stdout);
}

static void leave(int number)
{
    (void)number;
    exit(STATUS);
}

static void exits_in_a_handler(void)
{
    signal(SIGUSR1, leave);
    run(begin("handler"), 0, steps, stdout);
    raise(SIGUSR1);
}

static void note(int number)
{
    heard += number > 0;
}

/* A thousand signals, and every one of them is the host's own thread's. */
static void has_handlers_and_masks(void)
{
    struct sigaction action = { .sa_handler = note }, was;
    sigset_t blocked, now_blocked;

    sigemptyset(&blocked);
    sigaddset(&blocked, SIGUSR2);
    sigaction(SIGUSR1, &action, NULL);
    sigaction(SIGPIPE, &action, NULL);
    pthread_sigmask(SIG_SETMASK, &blocked, NULL);
    modald_stream *s = begin("signals");
    for (long i = 0; i < 1000; i++) {
        kill(getpid(), SIGUSR1);
        run(s, i, i + 1, stdout);
    }
    kill(getpid(), SIGUSR2);
    run(s, 1000, steps, stdout);
    modald_close(s);
    pthread_sigmask(SIG_SETMASK, NULL, &now_blocked);
    sigaction(SIGPIPE, NULL, &was);
    printf("heard %d, kept %d, pending %d\n", (int)heard,
           was.sa_handler == note && sigismember(&now_blocked, SIGUSR2) &&
               !sigismember(&now_blocked, SIGUSR1),
           sigpending(&blocked) == 0 && sigismember(&blocked, SIGUSR2));
}

/* As daemons do; the results' file then has a number that was somebody else's. */
static void closes_all_descriptors(void)
{
    char path[] = "/tmp/hosts-XXXXXX", line[64];
    modald_stream *s = begin("closer");

    run(s, 0, steps / 2, stdout);
    for (int fd = 3; fd < 1024; fd++)
        close(fd);
    int first = mkstemp(path);
    FILE *files[8] = { fdopen(first, "w+") };
    for (int i = 1; i < 8; i++)
        files[i] = fopen(path, "r");
    unlink(path);
    run(s, steps / 2, steps, files[0]);
    fflush(files[0]);
    for (int i = 1; i < 8; i++)
        printf("file %d is %d and begins %zu\n", i, fileno(files[i]),
               fread(line, 1, sizeof line, files[i]));
    modald_close(s);
    rewind(files[0]);
    for (size_t n; (n = fread(line, 1, sizeof line, files[0])) > 0;)
        fwrite(line, 1, n, stdout);
    for (int i = 0; i < 8; i++)
        printf("closed %d\n", fclose(files[i]));
}

/* The lowest free numbers are the host's, as without a stream. */
static void counts_its_descriptors(void)
{
    modald_stream *s = begin("counts");

    run(s, 0, steps, stdout);
    for (int i = 0; i < 4; i++)
        printf("descriptor %d\n", open("/dev/null", O_RDONLY));
    modald_close(s);
    printf("descriptor %d\n", open("/dev/null", O_RDONLY));
}

static void limit(int which, rlim_t value)
{
    struct rlimit r;

    getrlimit(which, &r);
    r.rlim_cur = value < r.rlim_max ? value : r.rlim_max;
    setrlimit(which, &r);
}

static void has_few_descriptors(void)
{
    limit(RLIMIT_NOFILE, 8);
    plain();
}

static void has_few_descriptors_later(void)
{
    modald_stream *s = begin("fewer");

    run(s, 0, steps / 2, stdout);
    limit(RLIMIT_NOFILE, 4);
    run(s, steps / 2, steps, stdout);
    modald_close(s);
}

/* No descriptor of the host's is kept alive: the reader of a pipe sees its end. */
static void closes_a_pipe(void)
{
    int ends[2];
    char byte;

    if (pipe(ends) != 0)
        exit(1);
    modald_stream *s = begin("pipe");
    run(s, 0, steps, stdout);
    close(ends[1]);
    printf("end of file %zd\n", read(ends[0], &byte, 1));
    modald_close(s);
}

static void has_small_files(void)
{
    limit(RLIMIT_FSIZE, 64);                         /* stdout is a pipe */
    plain();
}

static void changes_folder(void)
{
    modald_stream *s = begin("folder");

    run(s, 0, steps / 2, stdout);
    if (chdir("/proc/self") != 0)
        exit(1);
    run(s, steps / 2, steps, stdout);
    modald_close(s);
}

static void becomes_nobody(void)
{
    modald_stream *s = begin("nobody");

    run(s, 0, steps / 2, stdout);
    int done = getuid() != 0 || (setgid(65534) == 0 && setuid(65534) == 0);
    run(s, steps / 2, steps, stdout);
    printf("nobody %d\n", done);
    modald_close(s);
}

static void forks_children(void)
{
    modald_stream *s = begin("forks");
    int status = 0;

    for (int i = 0; i < 8; i++) {
        run(s, i * steps / 8, (i + 1) * steps / 8, stdout);
        fflush(stdout);
        pid_t child = fork();
        if (child == 0) {
            run(s, 0, 100, stdout);
            modald_close(s);
            exit(i);
        }
        waitpid(child, &status, 0);
        printf("child %d\n", WEXITSTATUS(status));
    }
    modald_close(s);
}

static void *half(void *name)
{
    FILE *log = tmpfile();
    modald_stream *s = begin(name);

    run(s, 0, steps, log);
    modald_close(s);
    return log;
}

static void join(pthread_t thread)
{
    char buffer[4096];
    void *log;

    pthread_join(thread, &log);
    rewind(log);
    for (size_t n; (n = fread(buffer, 1, sizeof buffer, log)) > 0;)
        fwrite(buffer, 1, n, stdout);
}

static void two(const char *first, const char *second)
{
    pthread_t a, b;

    pthread_create(&a, NULL, half, (void *)first);
    pthread_create(&b, NULL, half, (void *)second);
    join(a);
    join(b);
}

static void has_two_threads(void)
{
    two("one", "two");
}

static void opens_one_name_twice(void)
{
    two("same", "same");
}

static void pushes_after_close(void)
{
    modald_stream *s = begin("closed");

    run(s, 0, steps / 2, stdout);
    modald_close(s);
    run(s, steps / 2, steps, stdout);
    printf("verdict %d\n", modald_verdict(s));
    modald_close(s);
    modald_abandon(s);
}

/* Many streams one after the other: a closed one may not be confused with a later one. */
static void opens_and_closes(void)
{
    for (int i = 0; i < 12; i++) {
        char name[16];
        snprintf(name, sizeof name, "many%d", i);
        modald_stream *s = begin(name);
        run(s, 0, 20, stdout);
        modald_close(s);
        run(s, 20, 30, stdout);
    }
}

static void speaks_with_a_comma(void)
{
    if (setlocale(LC_ALL, "de_DE.UTF-8") == NULL)
        printf("no such language here\n");
    modald_stream *s = modald_open("comma", CHANNELS, 0.0025);
    modald_describe(s, NULL, "m", 0.125);
    run(s, 0, steps, stdout);
    modald_close(s);
    printf("%.3f\n", 0.5);
}

static void changes_its_environment(void)
{
    modald_stream *s = begin("environment");
    char value[64];

    for (long i = 0; i < steps; i++) {
        snprintf(value, sizeof value, "HOST_VARIABLE_%ld", i);
        setenv(value, "some text or other", 1);
        run(s, i, i + 1, stdout);
    }
    clearenv();
    modald_close(s);
}

/* A socket of the host's own, in a context of its own. */
static void uses_zmq(void)
{
    void *context = zmq_ctx_new(), *a = zmq_socket(context, ZMQ_PAIR),
         *b = zmq_socket(context, ZMQ_PAIR);
    char text[8] = "";
    modald_stream *s = begin("zmq");

    zmq_bind(a, "inproc://own");
    zmq_connect(b, "inproc://own");
    for (long i = 0; i < steps; i++) {
        zmq_send(a, "own", 4, 0);
        run(s, i, i + 1, stdout);
        zmq_recv(b, text, sizeof text, 0);
    }
    printf("%s\n", text);
    zmq_close(a);
    zmq_close(b);
    zmq_ctx_term(context);
    modald_close(s);
}

/* $HOSTS_LIBRARY as a plug-in, taken out again with its stream open. */
static void loads_and_unloads(void)
{
    const char *path = getenv("HOSTS_LIBRARY");

    for (int i = 0; i < 4; i++) {
        void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
        if (library == NULL) {
            fprintf(stderr, "%s\n", dlerror());
            exit(1);
        }
        modald_stream *(*open_it)(const char *, int, double);
        void (*push)(modald_stream *, const double *), (*close_it)(modald_stream *);
        *(void **)&open_it = dlsym(library, "modald_open");
        *(void **)&push = dlsym(library, "modald_push");
        *(void **)&close_it = dlsym(library, "modald_close");
        modald_stream *s = open_it("plug-in", CHANNELS, 1e-3);
        double y[CHANNELS];
        for (long k = 0; k < steps / 4; k++) {
            state(k, y);
            push(s, y);
            fwrite(y, sizeof *y, CHANNELS, stdout);
        }
        if (i % 2 == 0)
            close_it(s);
        printf("unloaded %d\n", dlclose(library));
        int child = fork();   /* what it asked to be called at a fork is gone with it */
        if (child == 0)
            _exit(0);
        waitpid(child, NULL, 0);
        nanosleep(&(struct timespec) { 0, 20000000 }, NULL);
    }
}

static void sends_what_is_no_number(void)
{
    modald_stream *s = begin("nan");
    const double y[CHANNELS] = { NAN, INFINITY };

    for (long i = 0; i < steps; i++) {
        run(s, i, i + 1, stdout);
        modald_push(s, y);
        modald_push_at(s, NAN, y);
        modald_push_at(s, -INFINITY, y);
    }
    modald_close(s);
}

/* Nobody reads what is said. */
static void has_a_closed_stderr_pipe(void)
{
    int ends[2];

    if (pipe(ends) != 0)
        exit(1);
    dup2(ends[1], 2);
    close(ends[0]);
    close(ends[1]);
    modald_open("", 0, -1);
    modald_open("bad", 2, NAN);
    plain();
}

static void opens_what_is_none(void)
{
    modald_open(NULL, 1, 1);
    modald_push(modald_open("none", 0, 1), NULL);
    modald_push(NULL, NULL);
    modald_push_at(NULL, 1, NULL);
    modald_push_block(NULL, NULL, 3);
    modald_describe(NULL, NULL, NULL, 0);
    modald_seek(NULL, 1);
    modald_close(NULL);
    plain();
}

static const struct habit { const char *name; void (*live)(void); } habits[] = {
    { "plain", plain },
    { "exits without close", exits_without_close },
    { "exits in a handler", exits_in_a_handler },
    { "has handlers and masks", has_handlers_and_masks },
    { "closes all descriptors", closes_all_descriptors },
    { "counts its descriptors", counts_its_descriptors },
    { "has few descriptors", has_few_descriptors },
    { "has few descriptors later", has_few_descriptors_later },
    { "closes a pipe", closes_a_pipe },
    { "has small files", has_small_files },
    { "changes folder", changes_folder },
    { "becomes nobody", becomes_nobody },
    { "forks children", forks_children },
    { "has two threads", has_two_threads },
    { "opens one name twice", opens_one_name_twice },
    { "pushes after close", pushes_after_close },
    { "opens and closes", opens_and_closes },
    { "speaks with a comma", speaks_with_a_comma },
    { "changes its environment", changes_its_environment },
    { "uses zmq", uses_zmq },
    { "loads and unloads", loads_and_unloads },
    { "sends what is no number", sends_what_is_no_number },
    { "has a closed stderr pipe", has_a_closed_stderr_pipe },
    { "opens what is none", opens_what_is_none },
};

int main(int argc, char **argv)
{
    double pause = argc > 3 ? atof(argv[3]) : 0;

    steps = argc > 2 ? atol(argv[2]) : steps;
    pace = (struct timespec) { (time_t)pause, (long)(1e9 * (pause - (double)(time_t)pause)) };
    for (size_t i = 0; i < sizeof habits / sizeof habits[0]; i++)
        if (argc > 1 && strcmp(argv[1], habits[i].name) == 0) {
            habits[i].live();
            return STATUS;
        }
    for (size_t i = 0; i < sizeof habits / sizeof habits[0]; i++)
        fprintf(stderr, "%s\n", habits[i].name);
    return 2;
}
