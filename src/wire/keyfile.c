/* keyfile.c - see keyfile.h */
#include "wire/keyfile.h"
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

#define BAD(...) modal_fail_field(err, MODAL_BAD_INPUT, "keyfile", __VA_ARGS__)

void keyfile_wipe(struct keyfile *keys)
{
    explicit_bzero(keys, sizeof *keys);
}

/* One line into KEYS; what is blank or a comment changes nothing. */
static bool read_line(char *line, struct keyfile *keys)
{
    struct { const char *name; char *to; } rows[] = {
        { "public-key", keys->public },
        { "secret-key", keys->secret },
        { "server-key", keys->server },
    };
    char name[32], value[64];

    line += strspn(line, " \t\r\n");
    if (*line == 0 || *line == '#')
        return true;
    if (sscanf(line, "%31[a-z-] = \"%63[^\"]\"", name, value) != 2 || strlen(value) != 40)
        return false;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        if (strcmp(name, rows[i].name) == 0) {
            memcpy(rows[i].to, value, 41);
            explicit_bzero(value, sizeof value);
            return true;
        }
    return false;
}

static enum modal_status read_lines(FILE *file, const char *path, struct keyfile *keys,
                                    struct modal_error *err)
{
    char line[256];

    for (int number = 1; fgets(line, sizeof line, file) != NULL; number++)
        if (!read_line(line, keys)) {
            explicit_bzero(line, sizeof line);
            return BAD(
                "%s: line %d: accepted: public-key, secret-key or server-key = \"40 signs of Z85\"",
                path, number);
        }
    explicit_bzero(line, sizeof line);
    return keys->public[0] && keys->secret[0] ? MODAL_OK
                                              : BAD("%s: no public-key or no secret-key", path);
}

enum modal_status keyfile_read(const char *path, struct keyfile *keys, struct modal_error *err)
{
    struct stat st;
    enum modal_status rc = MODAL_OK;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);     /* a FIFO makes nobody wait */
    FILE *file = fd >= 0 ? fdopen(fd, "r") : NULL;

    memset(keys, 0, sizeof *keys);
    if (file == NULL) {
        rc = BAD("%s: %s", path, strerror(errno));
        if (fd >= 0)
            close(fd);
        return rc;
    }
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode))
        rc = BAD("%s: no file; accepted: a file of mode 0600", path);
    else if ((st.st_mode & 077) != 0)
        rc = BAD("%s: others may read it (mode %04o); accepted: a file of mode 0600", path,
                 st.st_mode & 07777u);
    else if (st.st_uid != geteuid() && geteuid() != 0)
        rc = BAD("%s: belongs to another user", path);
    if (rc == MODAL_OK)
        rc = read_lines(file, path, keys, err);
    fclose(file);
    if (rc != MODAL_OK)
        keyfile_wipe(keys);
    return rc;
}

enum modal_status keyfile_make(const char *path, const char *server, char *public,
                               struct modal_error *err)
{
    struct keyfile keys = { 0 };
    char text[512];
    enum modal_status rc = MODAL_OK;
    int length, fd;

    if (server != NULL && strlen(server) != 40)
        return modal_fail_field(err, MODAL_BAD_INPUT, "server-key",
                                "accepted: the daemon's public key, 40 signs of Z85");
    do {                                        /* one key of 85 would be taken for an option */
        if (zmq_curve_keypair(keys.public, keys.secret) != 0)
            return modal_fail(err, MODAL_INTERNAL, "libzmq cannot make keys: %s",
                              zmq_strerror(errno));
    } while (keys.public[0] == '-');
    length = snprintf(text, sizeof text, "# modald key file: keep it secret, mode 0600\n"
                      "public-key = \"%s\"\nsecret-key = \"%s\"\n", keys.public, keys.secret);
    if (server != NULL)
        length += snprintf(text + length, sizeof text - (size_t)length, "server-key = \"%s\"\n",
                           server);
    fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (fd < 0)
        rc = BAD("%s: %s", path, strerror(errno));
    else if (write(fd, text, (size_t)length) != length || fsync(fd) != 0)
        rc = modal_fail(err, MODAL_IO, "%s: %s", path, strerror(errno));
    if (fd >= 0)
        close(fd);
    if (rc == MODAL_OK)
        memcpy(public, keys.public, 41);
    explicit_bzero(text, sizeof text);
    keyfile_wipe(&keys);
    return rc;
}
