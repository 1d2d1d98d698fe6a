#include "Launchid.hpp"
#include "vectors.h"
#include <cstring>

int main() {
    static Launchid component("launchid");
    for (int k = 0; k < VECTOR_FIRST; k++) {
        double v[7];
        std::memcpy(v, vector_sample[k], sizeof v);
        component.sampleIn(v[0], v[1], v[2], v[3], v[4], v[5], v[6]);
    }
    return 0;
}
