// What fpp makes of Launchid.fpp, as far as Launchid.cpp uses it: for a test, not the thing.
#ifndef LAUNCHID_COMPONENT_AC_HPP
#define LAUNCHID_COMPONENT_AC_HPP
#include <cstdint>
#include <cstdio>
typedef double F64;
typedef std::int32_t I32;
typedef std::int32_t FwIndexType;

class LaunchidComponentBase {
  public:
    explicit LaunchidComponentBase(const char* name) { static_cast<void>(name); }
    virtual ~LaunchidComponentBase() = default;
    void sampleIn(F64 t, F64 theta, F64 theta_dot, F64 beta, F64 theta_ddot, F64 beta_cmd, F64 gamma) {
        this->sampleIn_handler(0, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma);
    }

  protected:
    virtual void sampleIn_handler(FwIndexType portNum, F64 t, F64 theta, F64 theta_dot, F64 beta, F64 theta_ddot,
                                  F64 beta_cmd, F64 gamma) = 0;
    void log_WARNING_LO_Refused(I32 status) { std::printf("refused %d\n", static_cast<int>(status)); }
    void tlmWrite_t_end(F64 x) { std::printf("estimate %a", x); }
    void tlmWrite_a6(F64 x) { std::printf(" %a\n", x); }
    void tlmWrite_k1(F64 x) { static_cast<void>(x); }
    void tlmWrite_a6_std(F64 x) { static_cast<void>(x); }
    void tlmWrite_k1_std(F64 x) { static_cast<void>(x); }
    void tlmWrite_tracked_a6(F64 x) { static_cast<void>(x); }
    void tlmWrite_tracked_k1(F64 x) { static_cast<void>(x); }
    void tlmWrite_tracked_a6_std(F64 x) { static_cast<void>(x); }
    void tlmWrite_tracked_k1_std(F64 x) { static_cast<void>(x); }
    void tlmWrite_wind(F64 x) { static_cast<void>(x); }
    void tlmWrite_status(I32 x) { static_cast<void>(x); }
};
#endif
