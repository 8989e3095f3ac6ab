/* site.h - the whole of modald-web: what it was told, the daemon, who visits */
#ifndef WEB_SITE_H
#define WEB_SITE_H
#include <netinet/in.h>
#include "front.h"
#include "places.h"
#include "readers.h"
#include "service.h"

enum {
    SITE_NAMES = 16,                 /* of hosts by which it is reached */
    SITE_TOKEN = 32,                 /* hex digits: 128 bits */
};

struct site {
    struct sockaddr_storage bind;
    const char *names[SITE_NAMES];
    int name_count;
    bool actions;                    /* wished for; site_acts() says whether they are */
    char token[SITE_TOKEN + 1];      /* what an action must show: who has it has seen our page */
    struct service service;
    struct readers readers;
    struct places places;
    struct front front;
    struct MHD_Daemon *http;
    unsigned long requests;
};

/* May jobs be cancelled, retried and deleted from the page? */
bool site_acts(const struct site *site);
#endif
