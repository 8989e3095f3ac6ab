/* ledger_db.h - the database under the ledger: opening, schema, statements; shared by the ledger's
 * own files */
#ifndef STORE_LEDGER_DB_H
#define STORE_LEDGER_DB_H
#include <sqlite3.h>
#include "store/ledger.h"

enum {
    LEDGER_APPLICATION = 0x6d646c64,     /* "mdld" */
    LEDGER_MODE = 0640,                  /* of its files at most, whatever the umask */
    LEDGER_BUSY_MS = 5000,               /* for which a lock of another process is waited for */
    LEDGER_CHECKPOINT_PAGES = 1000,      /* of the log, before ledger_settle moves it to the
                                            database: SQLite's own default */
};

/* SQLite's error as ours, its text with WHAT. */
enum modal_status ledger_db_fail(sqlite3 *db, int code, const char *what, struct modal_error *err);

/*
 * Open DIR/ledger.db through our VFS.  WRITE: made if absent, its schema written or upgraded, in
 * WAL mode with full synchronisation; its directory entry is synced.  Otherwise it must be there,
 * and can only be read.
 */
enum modal_status ledger_db_open(const char *dir, bool write, sqlite3 **out,
                                 struct modal_error *err);

/* The file of a database at PATH, made if absent, and its log's and index's, are for nobody
 * beyond LEDGER_MODE. */
enum modal_status ledger_db_make(const char *path, struct modal_error *err);

/* Run one SQL text without results. */
enum modal_status ledger_db_run(sqlite3 *db, const char *sql, struct modal_error *err);

/* All rows to VISITOR. */
enum modal_status ledger_db_load(sqlite3 *db, const struct ledger_visitor *visitor,
                                 struct modal_error *err);

/* A row of segments, selected by these columns. */
#define LEDGER_SEGMENT_COLUMNS "stream, epoch, first, count, offset, length, crc"
struct segment_record ledger_segment_of(sqlite3_stmt *row);

/* Names of an input's channels as a JSON list's text (NULL: none). */
enum modal_status ledger_names_text(const struct input_shape *shape, char **text,
                                    struct modal_error *err);

/*
 * Is the write-ahead log at PATH whole as far as acknowledged groups go?  SQLite takes the first
 * bad frame for the end of the log, which is right for a group torn by a crash and wrong for damage
 * to older ones: a later group is only begun once those before are synced, and PATH's mark says how
 * far the log was synced.  MODAL_CORRUPT, with the frame and its offset, where later groups follow
 * a bad frame or the mark lies behind it, and where the log is empty or gone though the database
 * has not what the mark tells of; MODAL_OK otherwise.  The OWNER, before anything is written, also
 * cuts off what SQLite will not read.
 */
enum modal_status ledger_wal_check(const char *path, bool owner, struct modal_error *err);

/*
 * The mark: DIR/ledger.db-mark says that the first FRAMES frames of the log's present life were
 * synced, and what the last of them has.  ledger_mark_put writes it after each commit and does not
 * sync it: what it says was true before it could reach the disk, and an old or absent one only
 * tells less; its failures are ignored.  False: the log has no more what it had at the call before,
 * and nothing is written.  ledger_mark_holds: it has, or the database does, as where another
 * program moved it there.  If not, nothing more may be acknowledged nor moved to the database.
 * Before the log is emptied ledger_mark_end has the mark say, on stable storage, that nothing is to
 * be found there; not ENDED: the log must stay.  It fails as file_sync does.  After that
 * ledger_mark_emptied is called.
 */
struct ledger_mark;
struct ledger_mark *ledger_mark_open(const char *dir);      /* NULL: there will be no mark */
bool ledger_mark_put(struct ledger_mark *mark, int frames);
bool ledger_mark_holds(struct ledger_mark *mark);
enum modal_status ledger_mark_end(struct ledger_mark *mark, bool *ended, struct modal_error *err);
void ledger_mark_emptied(struct ledger_mark *mark);
void ledger_mark_close(struct ledger_mark *mark);
/* The store id of DB.  MODAL_CORRUPT: it has none. */
enum modal_status ledger_db_store(sqlite3 *db, char store[33], struct modal_error *err);
#endif
