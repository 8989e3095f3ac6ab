/* folder.h - a data folder, made and taken by one process */
#ifndef STORE_FOLDER_H
#define STORE_FOLDER_H
#include "base/error.h"

/* DIR and the folders in it, made where they are absent, on stable storage. */
enum modal_status folder_make(const char *dir, struct modal_error *err);
/* DIR is this process's as long as *LOCK is open.  MODAL_BUSY: another daemon has it. */
enum modal_status folder_lock(const char *dir, int *lock, struct modal_error *err);
/* So is the identifier STORE on this host, as long as *OUT is open.  MODAL_BUSY: a daemon has a
 * copy of DIR. */
enum modal_status folder_bind(const char *dir, const char *store, int *out,
                              struct modal_error *err);
#endif
