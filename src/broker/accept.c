/*
 * accept.c - a connection that no descriptor is left for is one that was broken off, not the end of the process
 *
 * libzmq's listener of ipc takes EMFILE of accept4 for a fault of its own and aborts; its listener of tcp, and both for
 * ECONNABORTED, try again at once, for as long as the connection waits (libzmq 4.3.4, ipc_listener.cpp and
 * tcp_listener.cpp): hence the nap, which those who are connected hardly notice and a core does.  A function of the
 * program comes before the C library's of the same name, for the libraries too.
 */
#include <errno.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int accept4(int fd, struct sockaddr *restrict address, socklen_t *restrict length, int flags)
{
    int out = (int)syscall(SYS_accept4, fd, address, length, flags);

    if (out < 0 && errno == EMFILE) {
        nanosleep(&(struct timespec) { .tv_nsec = 50000 }, NULL);
        errno = ECONNABORTED;
    }
    return out;
}
