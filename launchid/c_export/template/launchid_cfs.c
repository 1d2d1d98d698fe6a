/* An app for cFS: takes a message a sample, sends a message a window.  The message ids, the pipe's depth and the table
   of the scheduler are the mission's: define them before this file or in launchid_mission.h. */

#include "cfe.h"
#include "launchid.h"

#ifndef LAUNCHID_SAMPLE_MID
#define LAUNCHID_SAMPLE_MID 0x18F0
#endif
#ifndef LAUNCHID_ESTIMATE_MID
#define LAUNCHID_ESTIMATE_MID 0x08F0
#endif
#ifndef LAUNCHID_PIPE_DEPTH
#define LAUNCHID_PIPE_DEPTH 16
#endif

#define LAUNCHID_EVENT_STARTED 1
#define LAUNCHID_EVENT_REFUSED 2
#define LAUNCHID_EVENT_LENGTH 3

typedef struct {
    CFE_MSG_CommandHeader_t header;
$sample_members} LAUNCHID_Sample_t;

typedef struct {
    CFE_MSG_TelemetryHeader_t header;
$estimate_members    int32 status;  /* launchid_estimate_status */
    uint32 valid;
} LAUNCHID_Estimate_t;

static struct {
    uint32 run;
    CFE_SB_PipeId_t pipe;
    LAUNCHID_Estimate_t out;
    launchid_estimator estimator;
} app;

void LAUNCHID_AppMain(void);

static CFE_Status_t start(void)
{
    launchid_reset(&app.estimator);
    app.run = CFE_ES_RunStatus_APP_RUN;
    CFE_Status_t status = CFE_EVS_Register(NULL, 0, CFE_EVS_EventFilter_BINARY);
    if (status == CFE_SUCCESS) {
        status = CFE_MSG_Init(CFE_MSG_PTR(app.out.header), CFE_SB_ValueToMsgId(LAUNCHID_ESTIMATE_MID), sizeof app.out);
    }
    if (status == CFE_SUCCESS) {
        status = CFE_SB_CreatePipe(&app.pipe, LAUNCHID_PIPE_DEPTH, "LAUNCHID");
    }
    if (status == CFE_SUCCESS) {
        status = CFE_SB_Subscribe(CFE_SB_ValueToMsgId(LAUNCHID_SAMPLE_MID), app.pipe);
    }
    if (status == CFE_SUCCESS) {
        (void)CFE_EVS_SendEvent(LAUNCHID_EVENT_STARTED, CFE_EVS_EventType_INFORMATION, "launchid started");
    }
    return status;
}

static void take(const LAUNCHID_Sample_t *message)
{
    const launchid_sample sample = {$sample_of_message};
    const launchid_status status = launchid_update(&app.estimator, &sample);
    launchid_estimate estimate;
    if (status < LAUNCHID_ACCEPTED) {
        (void)CFE_EVS_SendEvent(LAUNCHID_EVENT_REFUSED, CFE_EVS_EventType_DEBUG, "sample refused: %d", (int)status);
    } else if (status == LAUNCHID_WINDOW_COMPLETE && launchid_get_estimate(&app.estimator, &estimate)) {
$fill_message        app.out.status = (int32)estimate.status;
        app.out.valid = estimate.valid ? 1U : 0U;
        CFE_SB_TimeStampMsg(CFE_MSG_PTR(app.out.header));
        (void)CFE_SB_TransmitMsg(CFE_MSG_PTR(app.out.header), true);
    } else {
        /* the window goes on */
    }
}

void LAUNCHID_AppMain(void)
{
    CFE_SB_Buffer_t *buffer = NULL;
    if (start() != CFE_SUCCESS) {
        app.run = CFE_ES_RunStatus_APP_ERROR;
    }
    while (CFE_ES_RunLoop(&app.run)) {
        CFE_MSG_Size_t size = 0;
        if (CFE_SB_ReceiveBuffer(&buffer, app.pipe, CFE_SB_PEND_FOREVER) != CFE_SUCCESS) {
            app.run = CFE_ES_RunStatus_APP_ERROR;
        } else if (CFE_MSG_GetSize(&buffer->Msg, &size) != CFE_SUCCESS || size != sizeof(LAUNCHID_Sample_t)) {
            (void)CFE_EVS_SendEvent(LAUNCHID_EVENT_LENGTH, CFE_EVS_EventType_ERROR, "a sample of the wrong length");
        } else {
            take((const LAUNCHID_Sample_t *)(const void *)buffer);
        }
    }
    CFE_ES_ExitApp(app.run);
}
