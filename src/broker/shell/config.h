/* config.h - the configuration: a file of `key = value` lines, and the command line over it */
#ifndef BROKER_CONFIG_H
#define BROKER_CONFIG_H
#include "broker/core/core.h"

enum {
    BINDS_MOST = 16,              /* endpoints: one a network of a machine, and more */
    PATH_ROOM = 4096,             /* PATH_MAX of Linux */
};

struct config {
    char file[PATH_ROOM];                 /* "" : none */
    char data[PATH_ROOM];
    char bind[BINDS_MOST][PATH_ROOM];
    int bind_count;
    char worker_bind[BINDS_MOST][PATH_ROOM];   /* for workers elsewhere; default none */
    int worker_bind_count;
    int workers, spool_threads;
    /* of clients at once, as far as the descriptor limit leaves them; 0: all that it leaves */
    int connections;
    /* of the socket file; until config_finish, -1: none was named */
    int ipc_mode;
    char worker_path[PATH_ROOM], worker_user[64];
    bool sandbox;
    char server_key[PATH_ROOM];           /* file with the daemon's CURVE keys; "" : no keys */
    char keys[PATH_ROOM];                 /* file with one line a user */
    char metrics_file[PATH_ROOM];
    double drain_s, metrics_s;
    struct settings settings;             /* accounts point into what follows */
    struct account *accounts;
    size_t account_count;
};

/*
 * The defaults.  No endpoint is among them: config_finish gives
 * $XDG_RUNTIME_DIR/modald/modald.ipc, or /run/modald/modald.ipc for root, where none was named;
 * nor ipc_mode, which is 0660 for a process of the group modald and else 0600.
 */
void config_init(struct config *config);
/* What it holds beside itself. */
void config_done(struct config *config);

/* Read FILE over CONFIG.  MODAL_BAD_INPUT names the line and what is accepted; an unknown key is
 * an error. */
enum modal_status config_read(struct config *config, const char *file, struct modal_error *err);

/* One setting, as a line of the file has it. */
enum modal_status config_set(struct config *config, const char *key, const char *value,
                             struct modal_error *err);

/*
 * Check what belongs together and read the key files: without keys only ipc, and loopback tcp, may
 * be bound, and nothing for workers elsewhere; key files must be the owner's alone (0600).  Fills
 * settings.
 */
enum modal_status config_finish(struct config *config, struct modal_error *err);

/* The daemon's own keys, Z85, from server_key; WIPE them after use. */
enum modal_status config_server_keys(const struct config *config, char public[41], char secret[41],
                                     struct modal_error *err);
#endif
