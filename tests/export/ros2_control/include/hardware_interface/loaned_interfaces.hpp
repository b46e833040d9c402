// The signatures of loaned_state_interface.hpp and loaned_command_interface.hpp.
#ifndef HARDWARE_INTERFACE__LOANED_INTERFACES_HPP_
#define HARDWARE_INTERFACE__LOANED_INTERFACES_HPP_

#include "hardware_interface/handle.hpp"

namespace hardware_interface
{
class LoanedStateInterface
{
public:
  explicit LoanedStateInterface(StateInterface::ConstSharedPtr state_interface) : handle_(std::move(state_interface)) {}
  LoanedStateInterface(const LoanedStateInterface & other) = delete;
  LoanedStateInterface(LoanedStateInterface && other) = default;

  const std::string & get_name() const { return handle_->get_name(); }

  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int max_tries = 10) const
  {
    static_cast<void>(max_tries);
    return handle_->get_optional<T>();
  }

private:
  StateInterface::ConstSharedPtr handle_;
};

class LoanedCommandInterface
{
public:
  using Deleter = std::function<void(void)>;

  explicit LoanedCommandInterface(CommandInterface::SharedPtr command_interface, Deleter && deleter = nullptr)
  : handle_(std::move(command_interface)), deleter_(std::move(deleter))
  {
  }
  LoanedCommandInterface(const LoanedCommandInterface & other) = delete;
  LoanedCommandInterface(LoanedCommandInterface && other) = default;

  const std::string & get_name() const { return handle_->get_name(); }

  template <typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int max_tries = 10)
  {
    static_cast<void>(max_tries);
    return handle_->set_value(value);
  }

  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int max_tries = 10) const
  {
    static_cast<void>(max_tries);
    return handle_->get_optional<T>();
  }

private:
  CommandInterface::SharedPtr handle_;
  Deleter deleter_;
};
}  // namespace hardware_interface

#endif
