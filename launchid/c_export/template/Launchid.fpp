@ On-board identification: a sample in, the estimate of each window as telemetry

port LaunchidSample(
$fpp_arguments)

passive component Launchid {

    @ A sample; NaN: not measured
    guarded input port sampleIn: LaunchidSample

$fpp_telemetry    telemetry status: I32 @< launchid_estimate_status

    event Refused($$status: I32) severity warning low format "sample refused: {}" throttle 10

    time get port timeCaller
    telemetry port tlmOut
    event port eventOut
    text event port textEventOut
}
