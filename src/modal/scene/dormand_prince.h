/* dormand_prince.h - coefficients of an explicit Runge-Kutta pair of order 8(5,3) with dense output
 */
#ifndef MODAL_DORMAND_PRINCE_H
#define MODAL_DORMAND_PRINCE_H

enum {
    DORMAND_PRINCE_END = 12,         /* the stage at the step's end, the next one's first */
    DORMAND_PRINCE_ALL = 16,         /* with three more for the dense output */
    DORMAND_PRINCE_DENSE = 7,        /* coefficients a state of the interpolant */
};

/* Of y' = F(t, y):  K_i = F(t + node_i h, y + h sum_j weight_ij K_j),  j < i. */
extern const double dormand_prince_node[DORMAND_PRINCE_ALL];
extern const double dormand_prince_weight[DORMAND_PRINCE_ALL][DORMAND_PRINCE_ALL];
/* h sum_j error_j K_j: what solutions of order 3 and of order 5 are off. */
extern const double dormand_prince_error3[DORMAND_PRINCE_ALL];
extern const double dormand_prince_error5[DORMAND_PRINCE_ALL];
/* h sum_j dense_ij K_j: the interpolant's coefficients from the fourth on. */
extern const double dormand_prince_dense[DORMAND_PRINCE_DENSE - 3][DORMAND_PRINCE_ALL];

#endif
