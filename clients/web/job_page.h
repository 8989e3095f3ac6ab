/* job_page.h - one job: its state, its picture, its result as tables; what may be done with it */
#ifndef WEB_JOB_PAGE_H
#define WEB_JOB_PAGE_H
struct visit;

enum { JOB_PAGE_RESULT_MOST = 1048576 };     /* bytes of a result shown: one frame of the wire */

/* Answer VISIT by the page of its job, or by its picture. */
void job_page_show(struct visit *visit);
/* Do what its address says to its job. */
void job_page_act(struct visit *visit);
#endif
