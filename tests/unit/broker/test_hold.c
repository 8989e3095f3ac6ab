/* Connections that are not read for a while: what epoll is asked, and of which descriptors. */
#include "broker/shell/accept.h"
#include "broker/shell/hold.h"
#include "check.h"
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

struct watch { int epoll, pair[2]; };

static struct watch begin(void)
{
    struct watch w = { .epoll = epoll_create1(0) };
    struct epoll_event event = { .events = EPOLLIN };

    CHECK(w.epoll >= 0 && socketpair(AF_UNIX, SOCK_STREAM, 0, w.pair) == 0);
    CHECK(write(w.pair[1], "x", 1) == 1);
    CHECK(epoll_ctl(w.epoll, EPOLL_CTL_ADD, w.pair[0], &event) == 0);
    return w;
}

static void end(struct watch *w)
{
    close(w->pair[0]);
    close(w->pair[1]);
    close(w->epoll);
}

static int heard(const struct watch *w)
{
    struct epoll_event event;

    return epoll_wait(w->epoll, &event, 1, 0);
}

TEST(what_comes_of_a_held_connection_is_heard_of_once_it_is_held_no_more)
{
    char byte;
    struct watch w = begin();

    CHECK(heard(&w) == 1);
    hold_set(w.pair[0], true);
    CHECK(hold_is(w.pair[0]) && heard(&w) == 0 && recv(w.pair[0], &byte, 1, 0) == -1);
    hold_set(w.pair[0], false);
    CHECK(!hold_is(w.pair[0]) && heard(&w) == 1 && recv(w.pair[0], &byte, 1, 0) == 1);
    end(&w);
}

TEST(a_number_that_has_left_its_epoll_is_read_by_whoever_has_it_next)
{
    char byte;
    struct watch w = begin();

    hold_set(w.pair[0], true);
    CHECK(epoll_ctl(w.epoll, EPOLL_CTL_DEL, w.pair[0], NULL) == 0);
    CHECK(!hold_is(w.pair[0]) && recv(w.pair[0], &byte, 1, 0) == 1);
    hold_set(w.pair[0], true);                     /* nobody's, as it is in none */
    CHECK(!hold_is(w.pair[0]));
    end(&w);
}

TEST(what_is_no_descriptor_of_a_connection_is_not_held)
{
    static const int none[] = { -1, CONNECTIONS_TRACKED, CONNECTIONS_TRACKED + 1 };

    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        hold_set(none[i], true);
        CHECK(!hold_is(none[i]));
        hold_set(none[i], false);
    }
}
