/* file_fault.h - the fault points of file.c, of SQLite's VFS and of HDF5's driver; rules as file.h
 * describes them */
#ifndef STORE_FILE_FAULT_H
#define STORE_FILE_FAULT_H
#include <stdbool.h>
#include "store/file.h"

/* What is to happen to one call. */
struct file_fault {
    int error;     /* errno to fail with; 0: none */
    bool cut;      /* move half the bytes only */
    bool kill;     /* SIGKILL once it is done */
};

#ifdef MODALD_FAULTS
/* Count one CALL and say what is to happen to it; does not return where a rule says `kill`. */
struct file_fault file_fault_next(enum file_call call);
/* To be called after it. */
void file_fault_after(struct file_fault fault);
#else
static inline struct file_fault file_fault_next(enum file_call call)
{
    (void)call;
    return (struct file_fault) { 0, false, false };
}
static inline void file_fault_after(struct file_fault fault)
{
    (void)fault;
}
#endif
#endif
