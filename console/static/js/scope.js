// What this session may do. LOOKS: why it may do nothing but look and STOP, null where it may do everything.

export const LOOKS = document.querySelector('meta[name="scope"]').content === "view" ? "This session may only look, and STOP" : null;
