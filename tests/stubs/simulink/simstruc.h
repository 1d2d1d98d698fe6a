/* What launchid_sfun.c uses of Simulink's simstruc.h: for a test, not the thing. */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H
typedef double real_T;
typedef int int_T;
typedef const real_T *const *InputRealPtrsType;
typedef struct { const real_T *in[16]; real_T out[16]; real_T work[20000]; int_T inputs, outputs, doubles; real_T period; } SimStruct;
#define SS_DOUBLE 0
#define SS_OPTION_EXCEPTION_FREE_CODE 1
#define ssSetNumSFcnParams(S, n) ((void)(S))
#define ssGetNumSFcnParams(S) (0)
#define ssGetSFcnParamsCount(S) (0)
#define ssSetNumContStates(S, n) ((void)(S))
#define ssSetNumDiscStates(S, n) ((void)(S))
#define ssSetNumInputPorts(S, n) (1)
#define ssSetNumOutputPorts(S, n) (1)
#define ssSetInputPortWidth(S, port, n) ((S)->inputs = (n))
#define ssSetInputPortDirectFeedThrough(S, port, yes) ((void)(S))
#define ssSetOutputPortWidth(S, port, n) ((S)->outputs = (n))
#define ssSetNumSampleTimes(S, n) ((void)(S))
#define ssSetNumDWork(S, n) ((void)(S))
#define ssSetDWorkWidth(S, at, n) ((S)->doubles = (n))
#define ssSetDWorkDataType(S, at, type) ((void)(S))
#define ssSetOptions(S, options) ((void)(S))
#define ssSetSampleTime(S, at, period_) ((S)->period = (period_))
#define ssSetOffsetTime(S, at, offset) ((void)(S))
#define ssGetOutputPortRealSignal(S, port) ((S)->out)
#define ssGetInputPortRealSignalPtrs(S, port) ((InputRealPtrsType)(S)->in)
#define ssGetDWork(S, at) ((void *)(S)->work)
#endif
