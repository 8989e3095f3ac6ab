/* rosco_bridge.c - ROSCO's ZeroMQ interface on one side, a modald stream on the other
 *
 * ROSCO (ZMQ_Mode 1) opens a REQ socket each time and sends its measurements as text, numbers parted by commas; it waits
 * for set points as text in the same form.  The bridge answers at once with the neutral ones, so that the controller is as
 * without it, and pushes the numbers behind the turbine's id, the status and the time (number 2) to a stream a turbine.
 *
 * usage: rosco_bridge ENDPOINT [COUNT]      such as tcp://127.0.0.1:5555; ends after COUNT messages (0: never)
 *
 * Neutral: yaw offset, torque offset, blade pitch offsets, then set points of power, all 0 but the last three references,
 * which are 1 of rated (read with PRC_Comm = 2 only).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>
#include "modald_stream.h"

enum { NUMBERS_MOST = 64, TURBINES_MOST = 256, LEADING = 3 };     /* id, status, time stand before the channels */

static const char neutral[] = "0.0,0.0,0.0,0.0,0.0,1.0,1.0,1.0";

struct turbine { int id; double before; modald_stream *stream; };

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
static struct turbine *find(struct turbine *all, int *count, int id, double t)
{
    for (int i = 0; i < *count; i++)
        if (all[i].id == id)
            return &all[i];
    if (*count == TURBINES_MOST)
        return NULL;
    all[*count] = (struct turbine) { id, t, NULL };
    return &all[(*count)++];
}

static void take(struct turbine *all, int *count, const double *x, int n)
{
    struct turbine *turbine = n > LEADING ? find(all, count, (int)x[0], x[2]) : NULL;
    char name[64];

    if (turbine == NULL)
        return;
    if (turbine->stream == NULL && x[2] > turbine->before) {
        snprintf(name, sizeof name, "rosco-%d", turbine->id);
        turbine->stream = modald_open(name, n - LEADING, x[2] - turbine->before);
    }
    modald_push_at(turbine->stream, x[2], x + LEADING);
}

int main(int argc, char **argv)
{
    static struct turbine all[TURBINES_MOST];
    long messages = argc > 2 ? atol(argv[2]) : 0;
    int count = 0;
    void *context = zmq_ctx_new(), *socket = zmq_socket(context, ZMQ_REP);

    if (argc < 2 || zmq_bind(socket, argv[1]) != 0) {
        fprintf(stderr, "usage: rosco_bridge ENDPOINT [COUNT]: %s\n", argc < 2 ? "an endpoint is needed" : zmq_strerror(zmq_errno()));
        return 2;
    }
    for (long i = 0; messages == 0 || i < messages; i++) {
        char text[8192];
        double x[NUMBERS_MOST];
        int length = zmq_recv(socket, text, sizeof text - 1, 0);
        if (length < 0)
            break;
        zmq_send(socket, neutral, sizeof neutral - 1, 0);      /* at once: the turbine waits */
        text[length < (int)sizeof text - 1 ? length : (int)sizeof text - 1] = 0;
        take(all, &count, x, read_numbers(text, x));
    }
    for (int i = 0; i < count; i++)
        modald_close(all[i].stream);
    zmq_close(socket);
    zmq_ctx_term(context);
    return 0;
}
