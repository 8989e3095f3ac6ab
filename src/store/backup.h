/* backup.h - a copy of a data folder, made beside a running daemon or without one */
#ifndef STORE_BACKUP_H
#define STORE_BACKUP_H
#include "base/error.h"

/*
 * A copy of DIR that a daemon can be started on, made while one may run: the ledger by SQLite's
 * backup, sealed inputs and results as hard links (copies on another file system), open uploads and
 * the samples of open streams copied.  TO must not exist; it is there whole and synced, or not at
 * all: until then it is TO.unfinished, which a backup that was ended leaves and the next one to TO
 * replaces.
 */
enum modal_status backup_folder(const char *dir, const char *to, struct modal_error *err);
#endif
