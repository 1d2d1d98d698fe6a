/* An S-function for Simulink: one input of $n_in signals (t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma; NaN: not
   measured), one output of $n_out + 2 (the estimate of the last window, its status, whether it is valid), which holds
   between windows.   mex -I. launchid_sfun.c launchid.c CFLAGS='$$CFLAGS -std=c99 -ffp-contract=off' */

#define S_FUNCTION_NAME launchid_sfun
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"

#include "launchid.h"

#include <math.h>

#define INPUTS $n_in
#define OUTPUTS ($n_out + 2)
#define DOUBLES ((int_T)((sizeof(launchid_estimator) + sizeof(real_T) - 1U) / sizeof(real_T)))

static void mdlInitializeSizes(SimStruct *S)
{
    ssSetNumSFcnParams(S, 0);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) {
        return;
    }
    ssSetNumContStates(S, 0);
    ssSetNumDiscStates(S, 0);
    if (!ssSetNumInputPorts(S, 1) || !ssSetNumOutputPorts(S, 1)) {
        return;
    }
    ssSetInputPortWidth(S, 0, INPUTS);
    ssSetInputPortDirectFeedThrough(S, 0, 1);
    ssSetOutputPortWidth(S, 0, OUTPUTS);
    ssSetNumSampleTimes(S, 1);
    ssSetNumDWork(S, 1);
    ssSetDWorkWidth(S, 0, DOUBLES);
    ssSetDWorkDataType(S, 0, SS_DOUBLE);
    ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
    ssSetSampleTime(S, 0, $period);
    ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_START
static void mdlStart(SimStruct *S)
{
    real_T *const y = ssGetOutputPortRealSignal(S, 0);
    launchid_reset((launchid_estimator *)ssGetDWork(S, 0));
    for (int_T k = 0; k < OUTPUTS; k++) {
        y[k] = (real_T)NAN;
    }
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
    InputRealPtrsType const u = ssGetInputPortRealSignalPtrs(S, 0);
    real_T *const y = ssGetOutputPortRealSignal(S, 0);
    launchid_estimator *const estimator = (launchid_estimator *)ssGetDWork(S, 0);
    const launchid_sample sample = {$sample_of_input};
    launchid_estimate estimate;
    (void)tid;
    if (launchid_update(estimator, &sample) == LAUNCHID_WINDOW_COMPLETE && launchid_get_estimate(estimator, &estimate)) {
$fill_output        y[$n_out] = (real_T)estimate.status;
        y[$n_out + 1] = estimate.valid ? 1.0 : 0.0;
    }
}

static void mdlTerminate(SimStruct *S)
{
    (void)S;
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
