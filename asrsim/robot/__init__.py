"""The robot as pure data: URDF and xacro files read, checked, prepared for an engine."""
