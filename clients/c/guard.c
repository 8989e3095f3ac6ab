/*
 * guard.c - connect and recv as libzmq's I/O thread calls them in our own programs that ask a
 * daemon: one that answers with a PING cut short (wire/zmtp.h) is hung up on
 *
 * A function of the program comes before the C library's of the same name, for the libraries too.
 * Not in the libraries that others link: a simulation's recv is its own.  What is known of a
 * connection is its thread's: libzmq connects and receives in one, and a descriptor of another
 * thread, which may have a table of its own, is another's.
 */
#include "wire/zmtp.h"
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { FOLLOWED = 256 };       /* descriptors; a program that asks has a dozen */

static _Thread_local struct zmtp connections[FOLLOWED];

int connect(int fd, const struct sockaddr *address, socklen_t length)
{
    if (fd >= 0 && fd < FOLLOWED)
        zmtp_begin(&connections[fd]);
    return (int)syscall(SYS_connect, fd, address, length);
}

ssize_t recv(int fd, void *buffer, size_t size, int flags)
{
    ssize_t got = syscall(SYS_recvfrom, fd, buffer, size, flags, NULL, NULL), at = 0;
    struct zmtp *z = &connections[fd >= 0 && fd < FOLLOWED ? fd : 0];

    if (fd < 0 || fd >= FOLLOWED || z->stage == ZMTP_NOTHING)
        return got;
    while (at < got && !z->strange && !z->cut_ping)
        at += (ssize_t)zmtp_next(z, (unsigned char *)buffer + at, (size_t)(got - at));
    if (z->strange)                             /* libzmq tells what that is */
        z->stage = ZMTP_NOTHING;
    return z->cut_ping ? 0 : got;
}
