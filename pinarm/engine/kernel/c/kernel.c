#include "bodies.h"
#include "closing.h"
#include "radau.h"
#include "runge_kutta.h"

/* Write the sizes in bytes of the structures in structures.py, in the order of STRUCTURES; return their number. */
int kernel_sizes(int room, int *sizes);

int kernel_sizes(int room, int *sizes) {
    static const size_t known[] = {
        sizeof(screw),        sizeof(body),       sizeof(link),         sizeof(degree),      sizeof(rotation_spring),
        sizeof(point_spring), sizeof(link_state), sizeof(degree_state), sizeof(loop),        sizeof(loop_state),
        sizeof(force),        sizeof(tree),       sizeof(skyline),      sizeof(constraints), sizeof(closing),
        sizeof(pair),         sizeof(flow),       sizeof(held),         sizeof(control),     sizeof(course),
        sizeof(radau),        sizeof(newton),     sizeof(bodies),
    };
    const int count = (int)(sizeof known / sizeof known[0]);
    for (int k = 0; k < count && k < room; k++)
        sizes[k] = (int)known[k];
    return count;
}
