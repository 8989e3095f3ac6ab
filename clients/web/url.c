/* url.c - see url.h */
#include "url.h"
#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include "base/utf8.h"

enum { DELETED = 0x7f };         /* the one control sign that is not below the space */

static int hex_digit(char c)
{
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
}

bool url_decode(const char *text, size_t length, char out[URL_NAME_MOST + 1])
{
    size_t used = 0;

    for (size_t i = 0; i < length; i++) {
        int c = (unsigned char)text[i];
        if (c == '%') {
            int high = i + 2 < length ? hex_digit(text[i + 1]) : -1,
                low = i + 2 < length ? hex_digit(text[i + 2]) : -1;
            if (high < 0 || low < 0)
                return false;
            c = 16 * high + low;
            i += 2;
        }
        if (c < ' ' || c == DELETED || used == URL_NAME_MOST)
            return false;
        out[used++] = (char)c;
    }
    out[used] = 0;
    return used > 0 && utf8_valid(out);
}

/* What follows "/jobs/": ID, ID.svg, or ID/VERB. */
static enum url_page read_job(const char *path, struct url *url)
{
    static const struct { const char *word, *verb; } actions[] = {
        { "cancel", "CANCEL" }, { "retry", "RETRY" }, { "delete", "DELETE" },
    };
    static const char suffix[] = ".svg";
    const char *slash = strchr(path, '/');
    size_t length = strlen(path), own = sizeof suffix - 1;

    if (slash == NULL && length > own && strcmp(path + length - own, suffix) == 0)
        return url_decode(path, length - own, url->name) ? URL_PICTURE : URL_NONE;
    if (slash == NULL)
        return url_decode(path, length, url->name) ? URL_JOB : URL_NONE;
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++)
        if (strcmp(slash + 1, actions[i].word) == 0)
            url->verb = actions[i].verb;
    return url->verb != NULL && url_decode(path, (size_t)(slash - path), url->name) ? URL_ACTION
                                                                                   : URL_NONE;
}

struct url url_read(const char *path)
{
    static const char jobs[] = "/jobs/", streams[] = "/streams/";
    struct url url = { .page = URL_NONE };

    if (strlen(path) > URL_MOST || path[0] != '/')
        return url;
    if (strcmp(path, "/") == 0)
        url.page = URL_FRONT;
    else if (strcmp(path, "/events") == 0)
        url.page = URL_EVENTS;
    else if (strcmp(path, "/metrics") == 0)
        url.page = URL_METRICS;
    else if (strncmp(path, jobs, sizeof jobs - 1) == 0)
        url.page = read_job(path + sizeof jobs - 1, &url);
    else if (strncmp(path, streams, sizeof streams - 1) == 0) {
        path += sizeof streams - 1;
        url.page = strchr(path, '/') == NULL && url_decode(path, strlen(path), url.name)
                     ? URL_STREAM
                     : URL_NONE;
    } else if (strchr(path + 1, '/') == NULL && url_decode(path + 1, strlen(path + 1), url.name))
        url.page = URL_FILE;
    return url;
}

void url_escape(const char *name, char out[3 * URL_NAME_MOST + 1])
{
    static const char plain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"
                                "0123456789-_.~:";
    size_t used = 0;

    for (size_t i = 0; name[i] != 0 && i < URL_NAME_MOST; i++)
        if (strchr(plain, name[i]) != NULL)
            out[used++] = name[i];
        else
            used += (size_t)sprintf(out + used, "%%%02X", (unsigned char)name[i]);
    out[used] = 0;
}

/* The name in HOST, without brackets and port, into NAME; false: it is of no such form. */
static bool read_host(const char *host, char name[URL_HOST_MOST + 1])
{
    bool brackets = host[0] == '[';
    size_t length = strcspn(host += brackets, brackets ? "]" : ":");
    const char *rest = host + length + brackets;

    if (length == 0 || length > URL_HOST_MOST || (brackets && host[length] != ']'))
        return false;
    memcpy(name, host, length);
    name[length] = 0;
    return *rest == 0 || (*rest == ':' && strspn(rest + 1, "0123456789") == strlen(rest + 1));
}

bool url_host_is_ours(const char *host, const char *const *names, size_t count)
{
    char name[URL_HOST_MOST + 1];
    struct in6_addr address;

    if (host == NULL || !read_host(host, name))
        return false;
    if (inet_pton(host[0] == '[' ? AF_INET6 : AF_INET, name, &address) == 1)
        return true;
    for (size_t i = 0; i < count; i++)
        if (strcasecmp(name, names[i]) == 0)
            return true;
    return strcasecmp(name, "localhost") == 0;
}

bool url_origin_is(const char *origin, const char *host)
{
    const char *at = strstr(origin, "://");

    return at != NULL && host != NULL && strcasecmp(at + 3, host) == 0;
}
