/* ledger_verbs.h - what each change of a ledger is in SQL */
#ifndef STORE_LEDGER_VERBS_H
#define STORE_LEDGER_VERBS_H
#include <sqlite3.h>
#include <stdbool.h>
#include "store/ledger.h"

enum { LEDGER_SQL_MOST = 2 };        /* statements of a verb */

/* The next parameter of a statement. */
struct ledger_binder { sqlite3_stmt *statement; int next; };

/* Each verb's statements, NULL behind the last; each is bound alike.  `must`: the last one must
 * change a row; `frees`: it makes free pages. */
extern const struct ledger_verb_sql {
    const char *sql[LEDGER_SQL_MOST];
    enum modal_status (*bind)(struct ledger_binder *, const struct ledger_change *,
                              struct modal_error *);
    bool must, frees;
} ledger_verbs[LEDGER_VERB_COUNT];

#endif
