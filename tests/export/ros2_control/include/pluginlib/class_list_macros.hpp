#ifndef PLUGINLIB__CLASS_LIST_MACROS_HPP_
#define PLUGINLIB__CLASS_LIST_MACROS_HPP_

// In ROS, the plugin's type is registered under its name; here it can be made by `make_plugin`.
#define PLUGINLIB_EXPORT_CLASS(Class, Base) \
  extern "C" Base * make_plugin(); \
  extern "C" Base * make_plugin() { return new Class(); }

#endif
