#ifndef HARDWARE_INTERFACE__HANDLE_HPP_
#define HARDWARE_INTERFACE__HANDLE_HPP_

#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace hardware_interface
{
class Handle
{
public:
  Handle(const std::string & prefix_name, const std::string & interface_name, double * value_ptr = nullptr)
  : prefix_name_(prefix_name), interface_name_(interface_name), name_(prefix_name + "/" + interface_name), value_ptr_(value_ptr)
  {
  }

  const std::string & get_name() const { return name_; }
  const std::string & get_interface_name() const { return interface_name_; }
  const std::string & get_prefix_name() const { return prefix_name_; }

  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional() const
  {
    return *value_ptr_;
  }

  template <typename T>
  [[nodiscard]] bool set_value(const T & value)
  {
    *value_ptr_ = value;
    return true;
  }

private:
  std::string prefix_name_, interface_name_, name_;
  double * value_ptr_;
};

class StateInterface : public Handle
{
public:
  using Handle::Handle;
  using ConstSharedPtr = std::shared_ptr<const StateInterface>;
};

class CommandInterface : public Handle
{
public:
  using Handle::Handle;
  using SharedPtr = std::shared_ptr<CommandInterface>;
  CommandInterface(const CommandInterface & other) = delete;
  CommandInterface(CommandInterface && other) = default;
};
}  // namespace hardware_interface

#endif
