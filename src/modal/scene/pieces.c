/* pieces.c - a growing list of pieces; see pieces.h
 *
 * Room grows by doubling and is kept from period to period: Newton's iteration asks for pieces at
 * every step, of about as many each time.
 */
#include "modal/scene/pieces.h"
#include <stdlib.h>

enum { PIECES_MOST = 1 << 20 };   /* of a law that turns at each sample of the finest grid */

void pieces_clear(struct law_pieces *p)
{
    p->count = 0;
    p->acts = p->undetermined = false;
}

void pieces_done(struct law_pieces *p)
{
    free(p->piece);
    *p = (struct law_pieces) { 0 };
}

enum modal_status pieces_add(struct law_pieces *p, const struct law_piece *piece,
                             struct modal_error *err)
{
    if (!(piece->to > piece->from))
        return MODAL_OK;                       /* an empty piece is none */
    if (p->count == p->room) {
        int room = p->room > 0 ? 2 * p->room : 32;
        struct law_piece *more =
            p->count < PIECES_MOST ? realloc(p->piece, (size_t)room * sizeof *more) : NULL;

        if (more == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "pieces: no memory for %d", room);
        p->piece = more;
        p->room = room;
    }
    p->piece[p->count++] = *piece;
    return MODAL_OK;
}
