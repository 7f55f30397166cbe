"""Chapter 4 and Appendix A: identification on the platform."""
