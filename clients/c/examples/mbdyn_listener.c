/* mbdyn_listener.c - MBDyn's stream output on one side, a modald stream on the other
 *
 * MBDyn's `stream motion output` or `stream output` element connects to a TCP or local socket and
 * writes n doubles of the host's byte order each output step, nothing else.  The listener binds,
 * takes one connection, pushes each row, and ends with the connection, or on SIGTERM.
 *
 * usage: mbdyn_listener PORT|PATH NAME CHANNELS DT
 * PORT is of 127.0.0.1, PATH that of a local socket.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE          /* accept4 */
#endif
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdint.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>
#include "modald_stream.h"

enum { CHANNELS_MOST = 65536 };    /* the daemon's limit */

static volatile sig_atomic_t ended;

static void on_signal(int number)
{
    ended = number;
}

static int listen_on(const char *where)
{
    struct sockaddr_in in = { .sin_family = AF_INET,
                              .sin_port = htons((uint16_t)atoi(where)),
                              .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
    struct sockaddr_un un = { .sun_family = AF_UNIX };
    bool local = strchr(where, '/') != NULL;
    int fd = socket(local ? AF_UNIX : AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), yes = 1;

    snprintf(un.sun_path, sizeof un.sun_path, "%s", where);
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    const struct sockaddr *at = local ? (struct sockaddr *)&un : (struct sockaddr *)&in;
    if (bind(fd, at, local ? sizeof un : sizeof in) != 0 || listen(fd, 1) != 0) {
        fprintf(stderr, "mbdyn_listener: %s: %s\n", where, strerror(errno));
        return -1;
    }
    return fd;
}

/* The one connection; -1: ended before. */
static int accept_one(int fd)
{
    const struct timeval look = { 0, 200000 };          /* between two looks for a signal */
    int from;

    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &look, sizeof look);
    while ((from = accept4(fd, NULL, NULL, SOCK_CLOEXEC)) < 0 && (errno == EINTR || errno == EAGAIN)
           && !ended)
        ;
    if (from >= 0)
        setsockopt(from, SOL_SOCKET, SO_RCVTIMEO, &look, sizeof look);
    return from;
}

/* A whole row; false at the end, or where the last row is cut short (a step never finished). */
static bool read_row(int fd, double *row, size_t length)
{
    size_t got = 0;

    while (got < length) {
        ssize_t n = read(fd, (char *)row + got, length - got);
        if (n < 0 && (errno == EINTR || errno == EAGAIN) && !ended)
            continue;
        if (n <= 0)
            return false;
        got += (size_t)n;
    }
    return true;
}

int main(int argc, char **argv)
{
    const struct sigaction stop = { .sa_handler = on_signal };
    int channels = argc == 5 ? atoi(argv[3]) : 0, fd, from;
    double *row;

    if (channels < 1 || channels > CHANNELS_MOST || !(atof(argv[4]) > 0)
        || (strchr(argv[1], '/') == NULL && (atoi(argv[1]) < 1 || atoi(argv[1]) > UINT16_MAX))) {
        fprintf(stderr, "usage: mbdyn_listener PORT|PATH NAME CHANNELS DT\n");
        return 2;
    }
    if (getenv("MODALD_URL") == NULL)
        fprintf(stderr,
                "mbdyn_listener: MODALD_URL is not set: rows are read, nothing is sent on\n");
    sigaction(SIGTERM, &stop, NULL);
    sigaction(SIGINT, &stop, NULL);
    row = malloc((size_t)channels * sizeof *row);
    fd = listen_on(argv[1]);
    if (row == NULL || fd < 0)
        return 1;
    from = accept_one(fd);
    modald_stream *s = modald_open(argv[2], channels, atof(argv[4]));
    while (from >= 0 && read_row(from, row, (size_t)channels * sizeof *row))
        modald_push(s, row);
    modald_close(s);
    if (from >= 0)
        close(from);
    close(fd);
    if (strchr(argv[1], '/') != NULL)
        unlink(argv[1]);
    free(row);
    return 0;
}
