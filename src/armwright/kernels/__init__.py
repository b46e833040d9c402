"""Program → native code. It knows no physics but the table of signatures."""
