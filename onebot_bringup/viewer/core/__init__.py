"""The core of the viewer: messages wait in an inbox, and displays draw them on a stage.

Each module imports only those before it: ``settings``, ``rerun_limits``, ``columns``, ``inbox``,
``glb``, ``robot_shapes``, ``transform_stream``, ``shown_robot``, ``stage``, ``display`` and
``drawing``.
The displays are built on it, and the view (``robot_view``) on the displays.
"""
