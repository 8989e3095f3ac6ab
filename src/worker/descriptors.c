/* descriptors.c - see descriptors.h */
#include "worker/descriptors.h"
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include "wire/protocol.h"
#include "worker/confine.h"

enum modal_status descriptors_open(struct modal_error *err)
{
    struct ucred maker;
    socklen_t size = sizeof maker;

    if (getsockopt(CONFINE_INPUTS, SOL_SOCKET, SO_PEERCRED, &maker, &size) < 0)
        return modal_fail(err, MODAL_BAD_INPUT, "worker: descriptor %d: %s", CONFINE_INPUTS,
                          strerror(errno));
    if (maker.pid != getppid())
        return modal_fail(err, MODAL_NO_SERVER, "worker: the daemon has ended");
    return MODAL_OK;
}

/* The next message: its text, and the descriptor; false: none is there. */
static bool receive(char *text, size_t room, int *out)
{
    union { char room[CMSG_SPACE(sizeof(int))]; struct cmsghdr align; } control;
    struct iovec part = { .iov_base = text, .iov_len = room - 1 };
    struct msghdr message = { .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control,
                              .msg_controllen = sizeof control };
    const struct cmsghdr *with;
    ssize_t length;

    while ((length = recvmsg(CONFINE_INPUTS, &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT)) < 0
           && errno == EINTR)
        ;
    with = length > 0 ? CMSG_FIRSTHDR(&message) : NULL;
    if (with == NULL || with->cmsg_level != SOL_SOCKET || with->cmsg_type != SCM_RIGHTS)
        return false;
    memcpy(out, CMSG_DATA(with), sizeof *out);
    text[length] = 0;
    return true;
}

/* It was sent before RUN was, and is here. */
enum modal_status descriptors_receive(const char *job, int attempt, int *out,
                                      struct modal_error *err)
{
    char wanted[WIRE_ID_MOST + 16], text[sizeof wanted];

    snprintf(wanted, sizeof wanted, "%s %d", job, attempt);
    while (receive(text, sizeof text, out)) {
        if (strcmp(text, wanted) == 0)
            return MODAL_OK;
        close(*out);
    }
    return modal_fail(err, MODAL_IO, "worker: the daemon handed over no input "
                      "for attempt %d of job %s", attempt, job);
}
