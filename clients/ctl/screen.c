/* screen.c - see screen.h */
#include "screen.h"
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>
#include "base/utf8.h"
#include "terminal.h"

/* Of a terminal that does not say: a VT100's. */
enum {
    COLUMNS = 80,             /* a card's */
    ROWS = 24                 /* what its memory held */
};

static struct termios before;            /* as the terminal was */
static volatile sig_atomic_t taken;

static void put(const char *text)
{
    for (size_t length = strlen(text); length > 0;) {
        ssize_t n = write(STDOUT_FILENO, text, length);
        if (n <= 0)
            return;
        text += n;
        length -= (size_t)n;
    }
}

/* Only what a handler may call. */
static void take(void)
{
    struct termios keys = before;

    keys.c_lflag &= ~(tcflag_t)(ICANON | ECHO);
    keys.c_cc[VMIN] = 1;
    keys.c_cc[VTIME] = 0;
    tcsetattr(STDIN_FILENO, TCSANOW, &keys);
    put("\033[?1049h\033[?25l");
    taken = 1;
}

static void give_back(void)
{
    if (!taken)
        return;
    taken = 0;
    put("\033[?25h\033[?1049l");
    tcsetattr(STDIN_FILENO, TCSANOW, &before);
}

/* The signal does what it does by default: the handler was for once. */
static void end_by(int number)
{
    give_back();
    raise(number);
}

static void stop(int number)
{
    struct sigaction action = { .sa_handler = SIG_DFL };
    sigset_t just;

    give_back();
    sigaction(number, &action, NULL);
    sigemptyset(&just);
    sigaddset(&just, number);
    raise(number);
    sigprocmask(SIG_UNBLOCK, &just, NULL);          /* it is held here, until SIGCONT */
    action.sa_handler = stop;
    sigaction(number, &action, NULL);
    take();
}

static void changed(int number)
{
    (void)number;                                   /* it ends the wait for a key */
}

void screen_begin(void)
{
    static const int ends[] = { SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGABRT, SIGSEGV };
    struct sigaction action = { .sa_handler = end_by, .sa_flags = SA_RESETHAND };

    tcgetattr(STDIN_FILENO, &before);
    atexit(give_back);
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++)
        sigaction(ends[i], &action, NULL);
    action.sa_flags = 0;
    action.sa_handler = stop;
    sigaction(SIGTSTP, &action, NULL);
    action.sa_handler = changed;
    sigaction(SIGWINCH, &action, NULL);
    take();
}

void screen_end(void)
{
    give_back();
}

void screen_size(int *columns, int *rows)
{
    struct winsize size = { 0 };

    ioctl(STDOUT_FILENO, TIOCGWINSZ, &size);
    *columns = size.ws_col > 0 ? size.ws_col : COLUMNS;
    *rows = size.ws_row > 0 ? size.ws_row : ROWS;
}

/* Bytes of the first COLUMNS characters of a line of LENGTH bytes of UTF-8. */
static size_t cut(const char *line, size_t length, int columns)
{
    size_t at = 0;

    for (int seen = 0; at < length; at++)
        if (((unsigned char)line[at] & 0xc0) != 0x80 && seen++ == columns)
            break;
    return at;
}

void screen_show(const char *text)
{
    FILE *out = terminal_stdout();
    int columns, rows;

    screen_size(&columns, &rows);
    fputs("\033[H", out);
    for (int row = 0; row < rows && *text != 0; row++) {
        size_t length = strcspn(text, "\n");
        utf8_put(out, text, cut(text, length, columns));
        fputs(row + 1 < rows ? "\033[K\r\n" : "\033[K", out);
        text += length + (text[length] == '\n');
    }
    fputs("\033[J", out);
    fflush(out);
}

int screen_key(double seconds)
{
    struct pollfd keys = { .fd = STDIN_FILENO, .events = POLLIN };
    unsigned char key;

    if (poll(&keys, 1, (int)(1000 * seconds)) <= 0)
        return 0;
    return read(STDIN_FILENO, &key, 1) == 1 ? key : 'q';         /* the terminal has gone */
}
