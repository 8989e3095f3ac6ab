/* rosco_bridge.c - ROSCO's ZeroMQ interface on one side, a modald stream on the other
 *
 * ROSCO (ZMQ_Mode 1) opens a REQ socket each time and sends its measurements as text, numbers
 * parted by commas; it waits for set points as text in the same form.  The bridge answers at once
 * with the neutral ones, so that the controller is as without it, and pushes the numbers behind the
 * turbine's id, the status and the time (number 2) to a stream a turbine.  The last call of a
 * simulation has a negative status: its stream is closed, and the turbine's next message begins
 * another.
 *
 * usage: rosco_bridge ENDPOINT [COUNT]
 * ENDPOINT is such as tcp://127.0.0.1:5555; ends after COUNT messages (0: never), or on SIGTERM.
 *
 * Neutral: yaw offset, torque offset, blade pitch offsets, then set points of power, all 0 but the
 * last three references, which are 1 of rated (read with PRC_Comm = 2 only).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE          /* POSIX, where the build asks for bare C */
#endif
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>
#include "modald_stream.h"

enum {
    NUMBERS_MOST = 64,      /* of a message: ROSCO sends 20 or so */
    TURBINES_MOST = 256,    /* as many as a user may have streams */
    LEADING = 3,            /* id, status, time stand before the channels */
    LOOK_MS = 200,          /* between two looks for a signal */
};

static const char neutral[] = "0.0,0.0,0.0,0.0,0.0,1.0,1.0,1.0";
static volatile sig_atomic_t ended;

struct turbine { int id, numbers; double before; modald_stream *stream; };

static void on_signal(int number)
{
    ended = number;
}

static int read_numbers(char *text, double *x)
{
    int n = 0;

    for (char *end; n < NUMBERS_MOST; n++, text = end + strspn(end, " ,")) {
        x[n] = strtod(text, &end);
        if (end == text)
            break;
    }
    return n;
}

/* The turbine of that id; its stream is opened by its second message, when the step is known. */
static struct turbine *find(struct turbine *all, int *count, int id, int numbers, double t)
{
    for (int i = 0; i < *count; i++)
        if (all[i].id == id)
            return &all[i];
    if (*count == TURBINES_MOST)
        return NULL;
    all[*count] = (struct turbine) { id, numbers, t, NULL };
    return &all[(*count)++];
}

static void take(struct turbine *all, int *count, const double *x, int n)
{
    struct turbine *turbine = n > LEADING ? find(all, count, (int)x[0], n, x[2]) : NULL;
    char name[64];

    /* a message of another length is another program's */
    if (turbine == NULL || n != turbine->numbers)
        return;
    if (turbine->stream == NULL && x[2] > turbine->before) {
        snprintf(name, sizeof name, "rosco-%d", turbine->id);
        turbine->stream = modald_open(name, n - LEADING, x[2] - turbine->before);
    }
    modald_push_at(turbine->stream, x[2], x + LEADING);
    if (x[1] < 0) {
        modald_close(turbine->stream);
        *turbine = all[--*count];
    }
}

/* One message and its answer; 0: none came. */
static int serve(void *socket, struct turbine *all, int *count)
{
    char text[8192];
    double x[NUMBERS_MOST];
    int length = zmq_recv(socket, text, sizeof text - 1, 0);

    if (length < 0)
        return 0;
    zmq_send(socket, neutral, sizeof neutral - 1, 0);   /* at once: the turbine waits */
    text[length < (int)sizeof text - 1 ? length : (int)sizeof text - 1] = 0;
    take(all, count, x, read_numbers(text, x));
    return 1;
}

int main(int argc, char **argv)
{
    static struct turbine all[TURBINES_MOST];
    const struct sigaction stop = { .sa_handler = on_signal };
    long messages = argc > 2 ? atol(argv[2]) : 0;
    int count = 0;
    void *context = zmq_ctx_new(), *socket = zmq_socket(context, ZMQ_REP);

    if (argc < 2 || zmq_bind(socket, argv[1]) != 0) {
        fprintf(stderr, "usage: rosco_bridge ENDPOINT [COUNT]: %s\n",
                argc < 2 ? "an endpoint is needed" : zmq_strerror(zmq_errno()));
        return 2;
    }
    if (getenv("MODALD_URL") == NULL)
        fprintf(stderr,
                "rosco_bridge: MODALD_URL is not set: ROSCO is answered, nothing is sent on\n");
    sigaction(SIGTERM, &stop, NULL);
    sigaction(SIGINT, &stop, NULL);
    zmq_setsockopt(socket, ZMQ_RCVTIMEO, &(int) { LOOK_MS }, sizeof(int));
    for (long i = 0; !ended && (messages == 0 || i < messages);)
        if (serve(socket, all, &count))
            i++;
        else if (errno != EINTR && errno != EAGAIN)
            break;
    for (int i = 0; i < count; i++)
        modald_close(all[i].stream);
    zmq_close(socket);
    zmq_ctx_term(context);
    return 0;
}
