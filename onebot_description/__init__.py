"""What OneBot is, and how any robot's description is read and published."""
