/* zmtp.h - a connection of ZMTP as its bytes come (RFC 37), for what libzmq must not read */
#ifndef WIRE_ZMTP_H
#define WIRE_ZMTP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct zmtp {
    enum { ZMTP_NOTHING, ZMTP_GREETING, ZMTP_FLAGS, ZMTP_LENGTH, ZMTP_BODY } stage;
    bool curve;                                 /* what the greeting says; its frames hide theirs */
    bool more, command;                         /* of the frame */
    bool strange;                               /* not of version 3 */
    bool cut_ping;                              /* a PING that ends before its time does */
    /* of a PING's beginning so far, in a command that is too short for one */
    unsigned char pinged;
    unsigned char have;           /* bytes of the greeting; of the length, those that are missing */
    uint64_t left;                              /* of the frame */
};

/* A connection before its first byte. */
void zmtp_begin(struct zmtp *z);

/*
 * The next of SIZE > 0 bytes AT, as many as are of one thing: of the greeting, a frame's flags, its
 * length, its body; how many they are.  Of a frame that ended the stage is ZMTP_FLAGS again.
 *
 * libzmq 4.3.4 answers a PING that is cut short with 16 bytes of its own memory behind it
 * (process_heartbeat_message: the length of what is to be echoed wraps around), which may be an
 * address.  Of NULL it is told here, by `cut_ping`; of CURVE it is not opened:
 * crypto_box_open_afternm is zmtp.c's in the programs that ask for it by name.
 */
size_t zmtp_next(struct zmtp *z, const unsigned char *at, size_t size);
#endif
