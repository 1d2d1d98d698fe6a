#include "Launchid.hpp"

Launchid::Launchid(const char* name) : LaunchidComponentBase(name), m_estimator() {
    launchid_reset(&this->m_estimator);
}

void Launchid::sampleIn_handler(
        FwIndexType portNum,
        $cpp_arguments) {
    static_cast<void>(portNum);
    const launchid_sample sample = {$sample_of_port};
    const launchid_status status = launchid_update(&this->m_estimator, &sample);
    if (status < LAUNCHID_ACCEPTED) {
        this->log_WARNING_LO_Refused(static_cast<I32>(status));
    } else if (status == LAUNCHID_WINDOW_COMPLETE) {
        this->report();
    } else {
        // the window goes on
    }
}

void Launchid::report() {
    launchid_estimate estimate;
    if (!launchid_get_estimate(&this->m_estimator, &estimate)) {
        return;
    }
$fill_telemetry    this->tlmWrite_status(static_cast<I32>(estimate.status));
}
