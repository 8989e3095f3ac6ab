/* notify.c - see notify.h */
#include "broker/shell/notify.h"
#include <ctype.h>
#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define YEAR_US (INT64_C(366) * 86400 * 1000000)   /* added to any clock in ns it is in range */

void notify_manager(const char *state)
{
    const char *path = getenv("NOTIFY_SOCKET");
    struct sockaddr_un address = { .sun_family = AF_UNIX };
    size_t length = path == NULL ? 0 : strlen(path);
    int fd;

    if (length < 2 || length >= sizeof address.sun_path)
        return;
    memcpy(address.sun_path, path, length);
    if (path[0] == '@')
        address.sun_path[0] = 0;                   /* an abstract name */
    fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return;
    sendto(fd, state, strlen(state), MSG_NOSIGNAL | MSG_DONTWAIT, (struct sockaddr *)&address,
           (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length));
    close(fd);
}

/* A whole number from 1 to MOST. */
static bool read_count(const char *text, int64_t most, int64_t *out)
{
    char *end;

    if (!isdigit((unsigned char)text[0]))
        return false;
    errno = 0;
    *out = strtoll(text, &end, 10);
    return errno == 0 && *end == 0 && *out >= 1 && *out <= most;
}

enum modal_status notify_watchdog(int64_t *ns, struct modal_error *err)
{
    static const int64_t half_ns = 500;            /* of a microsecond */
    const char *usec = getenv("WATCHDOG_USEC"), *pid = getenv("WATCHDOG_PID");
    int64_t us, process = getpid();

    *ns = 0;
    if (usec == NULL)
        return MODAL_OK;
    if (pid != NULL && !read_count(pid, INT32_MAX, &process))
        return modal_fail_field(err, MODAL_BAD_INPUT, "WATCHDOG_PID", "$WATCHDOG_PID is \"%.60s\"; "
                                "accepted: the number of a process", pid);
    if (!read_count(usec, YEAR_US, &us))
        return modal_fail_field(err, MODAL_BAD_INPUT, "WATCHDOG_USEC", "$WATCHDOG_USEC is "
                                "\"%.60s\"; accepted: microseconds, a whole number from 1 to %lld",
                                usec, (long long)YEAR_US);
    *ns = process == getpid() ? us * half_ns : 0;
    return MODAL_OK;
}
