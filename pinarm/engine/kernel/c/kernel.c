#include "closing.h"
#include "runge_kutta.h"

/* How many structures there are, and their sizes in bytes, in the order of SIZES in library.py. */
extern const int kernel_sizes[];

const int kernel_sizes[] = {
    20, sizeof(screw), sizeof(body), sizeof(link), sizeof(degree), sizeof(rotation_spring), sizeof(point_spring),
    sizeof(law), sizeof(link_state), sizeof(degree_state), sizeof(loop), sizeof(loop_state), sizeof(force),
    sizeof(tree), sizeof(skyline), sizeof(constraints), sizeof(closing), sizeof(pair), sizeof(flow),
    sizeof(control), sizeof(course),
};
