/* A bus for one app: the vectors' samples in, a line a message out. */
#include "cfe.h"
#include "vectors.h"
#include <stdio.h>
#include <string.h>

static int next;
static struct { CFE_MSG_CommandHeader_t header; double value[7]; } message;

void LAUNCHID_AppMain(void);

CFE_SB_MsgId_t CFE_SB_ValueToMsgId(uint32 value) { return (CFE_SB_MsgId_t){value}; }
CFE_Status_t CFE_EVS_Register(const void *f, uint16 n, uint16 s) { (void)f; (void)n; (void)s; return CFE_SUCCESS; }
CFE_Status_t CFE_EVS_SendEvent(uint16 id, uint16 t, const char *f, ...) { (void)t; (void)f; printf("event %d\n", id); return 0; }
CFE_Status_t CFE_MSG_Init(CFE_MSG_Message_t *m, CFE_SB_MsgId_t i, CFE_MSG_Size_t n) { (void)m; (void)i; (void)n; return 0; }
CFE_Status_t CFE_MSG_GetSize(const CFE_MSG_Message_t *m, CFE_MSG_Size_t *n) { (void)m; *n = sizeof message; return 0; }
CFE_Status_t CFE_SB_CreatePipe(CFE_SB_PipeId_t *p, uint16 d, const char *n) { (void)d; (void)n; *p = 1; return 0; }
CFE_Status_t CFE_SB_Subscribe(CFE_SB_MsgId_t i, CFE_SB_PipeId_t p) { (void)i; (void)p; return CFE_SUCCESS; }
void CFE_SB_TimeStampMsg(CFE_MSG_Message_t *m) { (void)m; }
bool CFE_ES_RunLoop(uint32 *status) { return *status == CFE_ES_RunStatus_APP_RUN && next < VECTOR_FIRST; }
void CFE_ES_ExitApp(uint32 status) { printf("exit %u\n", (unsigned)status); }

CFE_Status_t CFE_SB_ReceiveBuffer(CFE_SB_Buffer_t **buffer, CFE_SB_PipeId_t p, int32 t)
{
    (void)p;
    (void)t;
    memcpy(message.value, vector_sample[next++], sizeof message.value);
    *buffer = (CFE_SB_Buffer_t *)(void *)&message;
    return CFE_SUCCESS;
}

CFE_Status_t CFE_SB_TransmitMsg(const CFE_MSG_Message_t *m, bool count)
{
    double value[2];
    (void)count;
    memcpy(value, (const char *)m + sizeof(CFE_MSG_TelemetryHeader_t), sizeof value);
    printf("estimate %a %a\n", value[0], value[1]);
    return CFE_SUCCESS;
}

int main(void)
{
    LAUNCHID_AppMain();
    return 0;
}
