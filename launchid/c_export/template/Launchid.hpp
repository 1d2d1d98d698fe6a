// A component for F Prime; its base class is made of Launchid.fpp.

#ifndef LAUNCHID_HPP
#define LAUNCHID_HPP

#include "LaunchidComponentAc.hpp"

extern "C" {
#include "launchid.h"
}

class Launchid : public LaunchidComponentBase {
  public:
    explicit Launchid(const char* name);

  private:
    void sampleIn_handler(
        FwIndexType portNum,
        $cpp_arguments) override;

    void report();

    launchid_estimator m_estimator;
};

#endif
