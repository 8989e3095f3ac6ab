/* accept.h - how many connections there are, and may be; counted where libzmq accepts and closes them */
#ifndef BROKER_ACCEPT_H
#define BROKER_ACCEPT_H

/* From now on connections beyond MOST, 0: any number, are closed as they come, and those beyond what the descriptor limit leaves
 * (accept_default).  Those of workers are neither counted nor closed. */
void accept_most(int most);
/* Of the descriptors of this process, those that clients may have: the rest is for files, workers and ourselves. */
int accept_default(void);

int accept_open(void);             /* connections now */
long accept_refused(void);         /* closed as they came, since the start */
#endif
