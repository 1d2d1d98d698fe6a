/* A simulation of the vectors' samples, in the place of Simulink's generated code. */
#include "vectors.h"
#include <stdio.h>
#include <string.h>

int main(void)
{
    static SimStruct S;
    real_T v[7], last = -1.0;
    mdlInitializeSizes(&S);
    mdlInitializeSampleTimes(&S);
    if (S.inputs != 7 || S.doubles > 20000) {
        return 1;
    }
    for (int k = 0; k < 7; k++) {
        S.in[k] = &v[k];
    }
    mdlStart(&S);
    for (int k = 0; k < VECTOR_FIRST; k++) {
        memcpy(v, vector_sample[k], sizeof v);
        mdlOutputs(&S, 0);
        if (S.out[0] == S.out[0] && S.out[0] != last) {
            last = S.out[0];
            printf("estimate %a %a\n", S.out[0], S.out[1]);
        }
    }
    mdlTerminate(&S);
    return 0;
}
